"""Findings about hypotheses: what residuals follow, what explains them, and what states it."""

from __future__ import annotations

from echelon.identification.judge.hypothesis import Kind, Usual
from echelon.identification.judge.judge import Judged
from echelon.identification.logs.finding import Finding, note, warning

_SERIOUS = 0.01  # R² that is worth a warning, for effects that few robots have
_USUALLY = 1e-3  # the same for those that most have
_EFFECTS = (Kind.EFFECT, Kind.ROTOR)
_CONTRADICTS = (
    0.1  # gain from which on what is wrong with the readings speaks against the model
)

_NAMES = {
    Kind.EFFECT: "missing effect",
    Kind.ROTOR: "missing effect",
    Kind.CHANGE: "changes",
    Kind.GRAVITY: "gravity",
    Kind.GAIN: "gains",
    Kind.DELAY: "setup error",
    Kind.RATE: "setup error",
    Kind.ZERO: "setup error",
    Kind.JOINT: "joint",
    Kind.READING: "setup error",
    Kind.UNIT: "setup error",
}


def finding(judged: Judged, *, lists_effects: bool, taken: bool = False) -> Finding:
    """A finding about a hypothesis, for users of set-ups that list effects, or that have only the usual ones.

    What was ``taken`` into the model at once is said with how to state it.
    """
    name = _NAMES[judged.kind]
    if judged.kind in _EFFECTS:
        return _of_effect(judged, lists_effects=lists_effects, taken=taken)
    if judged.kind in (Kind.READING, Kind.UNIT):
        (before,), (after,) = judged.before, judged.after
        shares = f"from {before:.2%} to {after:.2%} of their spread"
        gain = f"; this change alone reduces the residuals of the outputs {shares}"
        text = judged.words + gain * (before < 1)
        return (note if taken else warning)(
            "gravity" if judged.gravity is not None else name, "", text + _taken(taken)
        )
    rises = ", ".join(
        f"{b:.4f} to {a:.4f}" for b, a in zip(judged.before, judged.after, strict=True)
    )
    text = f"{judged.words}: with this change R² on held-out rows rises ({rises})"
    if judged.kind is Kind.GAIN:
        text += (
            f".  Is it a current, or in another unit?  State  {judged.write},  or map currents under 'input' and add "
            "{type: drive_gain, at: all} to 'effects'"
        )
    elif judged.write:
        text += f": {judged.write}"
    return (note if taken else warning)(name, "", text + _taken(taken))


def _taken(taken: bool) -> str:
    return "; it is part of the model now" if taken else ""


def _of_effect(judged: Judged, *, lists_effects: bool, taken: bool) -> Finding:
    pairs = list(zip(judged.places, judged.entries, strict=True))
    together = {
        entry: [place for place, other in pairs if other == entry]
        for entry in judged.entries
    }
    lines = [
        entry.replace("{at}", f"[{', '.join(places)}]")
        for entry, places in together.items()
    ]
    entries = ", ".join(lines)
    line = (
        f"add {entries} to 'effects'"
        if lists_effects
        else f"write effects: [usual, {entries}]"
    )
    if judged.instead:
        line = f"write {entries} in 'effects' in place of {judged.instead} there"
    line = f"it is part of the model now; to state it, {line}" if taken else line
    rises = list(zip(judged.places, judged.before, judged.after, strict=True))
    gains = ", ".join(
        f"{name} {before:.4f} to {after:.4f}" for name, before, after in rises
    )
    text = f"residuals follow {judged.words}; with an effect for it R² on held-out rows rises ({gains}): {line}"
    least = _USUALLY if judged.usual is Usual.EVERYWHERE else _SERIOUS
    serious = any(after - before > least for _, before, after in rises)
    return (warning if serious else note)(_NAMES[judged.kind], "", text)


def contradiction(judged: Judged) -> str:
    """Why a model should not be used whatever it predicts; empty where a hypothesis does not say so."""
    if judged.kind in _EFFECTS or (
        judged.kind is not Kind.UNIT and judged.gain.mean < _CONTRADICTS
    ):
        return ""
    return f"a likely cause: {judged.words}"
