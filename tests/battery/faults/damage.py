"""Damage to a file by chance, described in a few words."""


def harmed(rng, whole: bytes, kinds=None) -> tuple[str, bytes]:
    """The content of a file with a bit changed, or with one of larger damages, of all `kinds` or of these."""
    size, content = len(whole), bytearray(whole)
    place, length = int(rng.integers(size)), int(min(rng.choice([1, 16, 512, 4096]), size))
    # Often at the end, where a seal is.
    begin, other = (int(rng.choice([rng.integers(size - length + 1), size - length], p=[0.7, 0.3])) for _ in "ab")
    kind = drawn(rng, kinds or ["bit"] * 5 + ["end", "zeros", "exchange", "more"])
    if kind == "bit":
        bit = int(rng.integers(8))
        content[place] ^= 1 << bit
        return f"bit {bit} of byte {place}", bytes(content)
    if kind == "end":
        return f"cut at {place}", whole[:place]
    if kind == "zeros":
        content[begin : begin + length] = bytes(length)
        return f"zeros from {begin}, {length}", bytes(content)
    if kind == "exchange":
        first, second = whole[begin : begin + length], whole[other : other + length]
        content[begin : begin + length], content[other : other + length] = second, first
        return f"{begin} and {other} exchanged, {length}", bytes(content)
    return f"{length} bytes more", whole + rng.bytes(length)


def drawn(rng, entries):
    """One of a list."""
    return entries[int(rng.integers(len(entries)))]
