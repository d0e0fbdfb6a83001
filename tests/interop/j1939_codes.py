"""What a raw value of a J1939 signal says, by the rules of J1939-71 and the value tables."""


def codes(signal):
    """Raw values that stand for no value, by our word for them."""
    words = {"error": "error", "not available": "not_available"}
    choices = signal.choices or {}
    return {words[str(text)]: raw for raw, text in choices.items() if str(text) in words}


def is_described(signal):
    """Whether the value table is more than codes and the name of one special value."""
    return len(signal.choices or {}) > max(1, len(codes(signal)))


def meaning(signal, raw):
    """None for a value, else our word for the code that it is."""
    if "not_available" not in codes(signal):
        return None
    # The top byte of whole bytes, the last two values of shorter fields.
    step = 1 << (signal.length - 8) if signal.length % 8 == 0 else 1
    if raw >= (1 << signal.length) - step:
        return "not_available"
    scaled = raw * signal.conversion.scale + signal.conversion.offset
    in_error = raw == codes(signal).get("error") or scaled > signal.maximum + 1e-9
    return "error" if in_error else None
