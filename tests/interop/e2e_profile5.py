"""AUTOSAR E2E Profile 5, offset 0, written bit by bit: a second opinion on our CRC."""


def crc16(data: bytes) -> int:
    """CRC-16/IBM-3740: polynomial 0x1021, start value 0xFFFF, nothing reflected."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ (0x1021 if crc & 0x8000 else 0)
            crc &= 0xFFFF
    return crc


def protected(message, signals: dict, counter: int) -> bytes:
    """Encodes `signals` with cantools and adds counter and CRC."""
    data_id = message.dbc.attributes["E2EDataId"].value
    signals = {**signals, "E2eCounter": counter, "E2eCrc": 0}
    data = message.encode(signals, strict=True)
    crc = crc16(data[2:] + data_id.to_bytes(2, "little"))
    return message.encode({**signals, "E2eCrc": crc}, strict=True)
