"""pynmea2 as an instrument at the pseudo-terminal: all sentences are valid and headings correct."""

import pynmea2

from served import ServedModule, check_errors, wrap_180

HEADING_DEG = 123.0
DECLINATION_DEG = -3.5

with ServedModule() as module:
    module.type(f"set declination {DECLINATION_DEG}", f"ok declination {DECLINATION_DEG} deg")
    module.hold_heading(HEADING_DEG)
    errors = []
    counts = {"HDM": 0, "HDG": 0, "HDT": 0, "ASW": 0}
    with open(module.pty, "rb", buffering=0) as serial:
        read = b""
        lines = []
        while len(lines) < 80:
            *more, read = (read + serial.read(1024)).split(b"\r\n")
            lines += more
    # The first sentence may be incomplete.
    for line in lines[1:]:
        sentence = pynmea2.parse(line.decode(), check=True)
        kind = sentence.sentence_type if isinstance(sentence, pynmea2.TalkerSentence) else sentence.manufacturer
        counts[kind] += 1
        heading = sentence.data[1] if kind == "ASW" else sentence.heading
        expected_deg = HEADING_DEG + (DECLINATION_DEG if kind == "HDT" else 0.0)
        errors.append(wrap_180(float(heading) - expected_deg))
        if kind == "HDG":
            variation = (float(sentence.variation), sentence.var_dir, sentence.deviation)
            assert variation == (-DECLINATION_DEG, "W", None), repr(sentence)
        if kind == "HDT":
            assert sentence.hdg_true == "T", repr(sentence)
    assert min(counts.values()) >= 19, counts
    mean_deg = check_errors(errors)
print(f"pynmea2: {counts}, mean error {mean_deg:.1f} deg")
