"""pynmea2 as an instrument at the pseudo-terminal: every sentence is one, and the headings are true."""

import pynmea2

from served import HEADING_BOUND_DEG, Served, wrap_180

HEADING_DEG = 123.0

with Served() as module:
    module.type("set declination -3.5", "ok declination -3.5 deg")
    module.hold(HEADING_DEG)
    counts = {"HDM": 0, "HDG": 0, "ASW": 0}
    with open(module.pty, "rb", buffering=0) as serial:
        read = b""
        lines = []
        while len(lines) < 60:
            *more, read = (read + serial.read(1024)).split(b"\r\n")
            lines += more
    # The first may have begun before it was listened to.
    for line in lines[1:]:
        sentence = pynmea2.parse(line.decode(), check=True)
        kind = sentence.sentence_type if isinstance(sentence, pynmea2.TalkerSentence) else sentence.manufacturer
        counts[kind] += 1
        heading = {"HDM": lambda: sentence.heading, "HDG": lambda: sentence.heading, "ASW": lambda: sentence.data[1]}[kind]()
        error_deg = wrap_180(float(heading) - HEADING_DEG)
        assert abs(error_deg) < HEADING_BOUND_DEG, f"{line}: {error_deg:.1f} deg off"
        if kind == "HDG":
            assert (float(sentence.variation), sentence.var_dir, sentence.deviation) == (3.5, "W", None), repr(sentence)
    assert min(counts.values()) >= 19, counts
print(f"pynmea2: {counts}")
