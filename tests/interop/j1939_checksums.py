"""The checksums of j1939.dbc from their published formulas: a second opinion on ours.

TSC1: the formula of SPN 4207. XBR: that of SPN 3188. CRC8: CRC-8/SAE-J1850, bit by bit.
"""

PROTECTIONS = ["none", "TSC1", "XBR", "CRC8"]


def identifier_bytes(identifier: int) -> bytes:
    return identifier.to_bytes(4, "little")


def message_sum(identifier: int, data: bytes) -> int:
    return sum(data[:7]) + (data[7] & 0x0F) + sum(identifier_bytes(identifier))


def tsc1(identifier: int, data: bytes) -> int:
    checksum = message_sum(identifier, data)
    return (((checksum >> 6) & 0x03) + (checksum >> 3) + checksum) & 0x07


def xbr(identifier: int, data: bytes) -> int:
    checksum = message_sum(identifier, data)
    return ((checksum >> 4) + checksum) & 0x0F


def crc8(data: bytes) -> int:
    """CRC-8/SAE-J1850: polynomial 0x1D, start value 0xFF, nothing reflected, inverted."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = ((crc << 1) ^ (0x1D if crc & 0x80 else 0)) & 0xFF
    return crc ^ 0xFF


def protected(message, signals: dict) -> bytes:
    """Encodes `signals`, the counter among them, with cantools and adds the checksum."""

    def encoded(values):
        # Unused bits are 1.
        return message.encode(values, strict=True, padding=True)

    protection = PROTECTIONS[message.dbc.attributes["Protection"].value]
    if protection == "none":
        return encoded(signals)
    data = encoded({**signals, "MessageChecksum": 0})
    checksum = {
        "TSC1": lambda: tsc1(message.frame_id, data),
        "XBR": lambda: xbr(message.frame_id, data),
        "CRC8": lambda: crc8(data[:7] + identifier_bytes(message.frame_id)),
    }[protection]()
    return encoded({**signals, "MessageChecksum": checksum})
