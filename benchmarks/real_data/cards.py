"""Print the cards of the measured machines as a page of the documentation.

    python -m benchmarks.real_data.cards > docs/explanation/measured-machines.md
"""

from __future__ import annotations

from benchmarks.real_data.run import ladder, screw, servo_splits

TOP = """# Measured machines

Cards of two lead-screw drives and of a servo with a pendulum, measured by others. Made by
`python -m benchmarks.real_data.cards`; the studies are in `examples/`.
"""
MOST = 3


def machines():
    """Name, study and channel of each machine."""
    for number in (1, 2):
        yield f"Lead-screw drive {number}", screw(number), "tau"
    value, study = next(servo_splits("trajectory"))
    yield f"Servo with a pendulum (XL330), trajectory {value} held out", study, "voltage"


def page():
    """Lines of the page."""
    from pycosim.fit.nullspace import number
    from pycosim.report import cards
    yield TOP
    for name, study, channel in machines():
        result = ladder(study)
        library = result.project.library
        yield f"## {name}\n"
        errors = " -> ".join(number(s.held_out_error[channel]) for s in result.steps)
        yield f"Held-out error of `{channel}`, step by step: {errors}; what is left: `{result.last.verdict}`.\n"
        for step, before in zip(result.steps[1:], result.steps):
            finding = step.fitted.reached.finding
            yield f"**Added: {finding.effect} at {finding.place}.**"
            yield f"{cards.sentence(library, finding, before.error)}"
            yield (f"Predicted: {number(finding.predicted_error[channel])}; realised: "
                   f"{number(step.error[channel])}. What would decide: {cards.experiment(library, finding)}.\n")
        beside = [c for c in result.first.candidates if not c.accepted][:MOST]
        if beside:
            yield "Next on the list, before anything was added:\n"
            for c in beside:
                yield f"- {c.name}: {c.sentence}"
            yield ""


def main():
    """Command line."""
    import textwrap
    for line in "\n".join(page()).split("\n"):
        indent = "  " if line.startswith("- ") else ""
        print("\n".join(textwrap.wrap(line, 118, subsequent_indent=indent)) if line else "")


if __name__ == "__main__":
    main()
