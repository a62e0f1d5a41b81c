"""Names of columns: quantity, joint, number and unit that they say; and joints of a robot that its log does not have.

A name such as ``q_rad_1``, ``/joint_states/position/elbow``, ``torques[0]`` or ``time [ms]`` is understood word by
word, and only if every word is: ``tau_fric1`` is some torque, but not the measured one.  The words are those of the
usual recorders: JointState, RTDE (``actual_q_0``, ``actual_current_0``), libfranka (``state.tau_J[0]``,
``state.q_d[0]``), FRI (``measured_torque_0``, ``axisQMsr[0]``), LeRobot (``observation.state/elbow_flex.pos``,
``action[0]``), MuJoCo (``qpos[0]``), controllers (``$AXIS_ACT.A1``) and tables whose columns are called ``joint_0`` and
``torque_0``; in English, and in the languages of the makers of robots (``Achse1_Ist``, ``par_motor_1``).

Joints that are not logged are a gripper, a rail, a mobile base, the other arm.  Names of joints in the names of columns
tell which ones are logged; else their number does: joints that are numbered like the columns, or a run of as many
joints along a chain.  What is left must look like what is bolted to an arm: it slides, has several freedoms, is on
another branch, or is called a gripper or a base.  The seventh joint of an arm does not.
"""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, takewhile

from echelon.identification.logs.units import fits
from echelon.robot import GROUND, Mechanism, MotionKind


def _by_word(table: Mapping[str, str]) -> dict[str, str]:
    """A table of words in a row by their meaning, turned round."""
    return {word: meaning for meaning, words in table.items() for word in words.split()}


_WORDS = {
    "position": "q qs qpos pos posn position positions angle angles enc encoder encoders theta th mp winkel "
    "lage posicion posizione angulo angolo",
    "velocity": "v dq qd qdot qp qvel dtheta thetadot omega vel velocity velocities speed speeds geschwindigkeit "
    "drehzahl velocidad vitesse velocita",
    "acceleration": "a ddq qdd ddqot ddqdt qddot qacc acc accel acceleration accelerations beschleunigung aceleracion",
    "output": "tau taus torque torques trq torq eff effort efforts force forces frc moment moments qfrc mt drehmoment "
    "kraft par couple coppia",
    "current": "i iq curr current currents cur amp amps ampere strom corriente courant corrente",
    "time": "t ts tout time times timestamp timestamps stamp datetime clock elapsed seconds zeit uhrzeit zeitstempel "
    "tiempo temps tempo",
}
_KIND_OF_WORD = _by_word(_WORDS)
_WEAK = frozenset(
    "a v i t d"
)  # letters that name the measurement only where no word does
_OTHERS = {
    "reference": "ref refs reference target targets des desired cmd cmds command commanded setpoint sp goal ipo d "
    "action qref qdes qcmd soll sollwert consigne",
    "motor": "motor motors actuator actuators mot mtr m",
    "joint": "joint joints jnt jnts j dof dofs axis axes ax a rax robax achse eje axe asse gelenk "
    "articulacion giunto link",
    "state": "observation observations obs state states ist istwert",
    "rate": "dot",
    "neutral": "meas measured msr msrd act actual read present field data feedback fb sensor per log value values msg "
    "header unix ros output est estimated sim robot main arm out yout signal signals js",
}
_ROLES = _by_word(_OTHERS)
_COMMANDS = frozenset(_OTHERS["reference"].split())
_NEUTRAL = frozenset(_OTHERS["neutral"].split())
KNOWN = frozenset(_KIND_OF_WORD) | frozenset(
    _ROLES
)  # words that say something of what is measured
_UNITS = _by_word(
    {
        "rad": "rad",
        "deg": "deg degree degrees grad grados",  # grad is German, not gon
        "rad/s": "rads radps",
        "deg/s": "degs degps dps",
        "rad/s²": "rads2",
        "rpm": "rpm",
        "m": "m",
        "mm": "mm",
        "N·m": "nm",
        "mN·m": "mnm",
        "N": "n",
        "mA": "ma",
        "s": "s sec",
        "ms": "ms",
        "us": "us",
        "ns": "ns nsec",
    }
)
_PER_SECOND = {"rad s": "rad/s", "deg s": "deg/s", "m s": "m/s", "mm s": "mm/s"}
_BRACKETS = re.compile(r"\s*[\[(]\s*([^\[\]()]*[A-Za-z°%‰][^\[\]()]*?)\s*[\])]")
_COLUMN_UNITS = _by_word(
    {
        "deg": "grad grados",
        "rpm": "u/min 1/min",
        "kgf·cm": "kg.cm kg·cm kg*cm kgcm kg-cm",
        "‰": "permille promille 1/1000",
    }
)
_COLUMN_UNITS |= dict.fromkeys(("per mille", "per mil"), "‰")
SHARES = ("%", "‰")  # what torques are in that are shares of a rated one
_GREEK = str.maketrans({"θ": "theta", "ϑ": "theta", "τ": "tau", "ω": "omega"})
_ANGLES = frozenset({"rad", "deg", "rads", "degs"})
_RATES = {"position": "velocity", "velocity": "acceleration"}
_BY_UNIT = {
    "output": ("N·m", "N"),
    "velocity": ("rad/s", "m/s"),
    "current": ("A",),
}  # joint 1 (Nm)
_HUMPS = (
    re.compile(r"(?<=[a-z])(?=[A-Z][a-z])"),
    re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])"),
)
_BEGINS = r"(?:(?<![a-z0-9])|(?-i:(?<=[a-z])(?=[A-Z])))"
_ENDS = r"(?:(?![a-z0-9])|(?-i:(?<=[a-z])(?=[A-Z])))"
_AFFIX = re.compile(
    r"^(?:joint|jnt|motor|axis)[_-]|[_-](?:joint|jnt|motor|axis)$", re.IGNORECASE
)
_TRAILING_NUMBER = re.compile(r"\d{1,9}$")  # longer ones are no numbers of joints
_BARE = frozenset({"joint", "state", "neutral"})
_STRONG = frozenset(_KIND_OF_WORD) - _WEAK
_PREFIXES = {"j"} | {
    word for word in _ROLES if len(word) > 2
}  # first parts of compounds


@dataclass(frozen=True)
class Meaning:
    """The meaning of a column's name."""

    # ``position``, ``velocity``, ``acceleration``, ``output``, ``current``, ``reference``, ``time`` or ``joint``
    kind: str
    name: str = ""  # coordinate, output or actuator that it names; empty if it has none
    index: int | None = None  # its number
    motor: bool = False  # whether it says that it was measured at a motor
    unit: str = ""


def aliases(names: Iterable[str]) -> dict[str, str]:
    """Coordinates by what columns may call them: their names, also without ``_joint``."""
    whole = list(dict.fromkeys(names))
    short = [_AFFIX.sub("", name) for name in whole]
    known = {
        alias: name
        for alias, name in zip(short, whole, strict=True)
        if alias and short.count(alias) == 1
    }
    return known | {name: name for name in whole}


def meaning(column: str, known: Mapping[str, str]) -> Meaning | None:
    """The meaning of a name, with coordinates by their aliases; None if there is a word that is not understood."""
    rest, unit, name = unicodedata.normalize("NFKD", column), "", ""
    bracket = _BRACKETS.search(rest)
    if bracket and bracket.group(1).lower() not in map(
        str.lower, known
    ):  # position[elbow]
        unit = bracket.group(1)
        rest = (rest[: bracket.start()] + "_" + rest[bracket.end() :]).strip("_ ")
    for alias in sorted(known, key=lambda n: (-len(n), n)):
        # a name that could also be a quantity's, such as q1, is left to its number
        spelt = r"[\W_]*".join(map(re.escape, re.findall(r"[^\W_]+", alias)))
        parted = re.split(rf"{_BEGINS}{spelt}{_ENDS}", rest, flags=re.IGNORECASE)
        whole = rest.lower() == alias.lower() and _by_words(alias, "", "") is None
        if len(parted) == 2 and (re.search("[A-Za-z]", "".join(parted)) or whole):
            rest, name = "_".join(parted), known[alias]
            break
    for hump in _HUMPS:
        found = _by_words(hump.sub("_", rest), name, unit)
        if found is not None:
            return found
    # the first parts of a topic are names that somebody chose
    *_, inner, last = ["", "", *rest.split("/")]
    if rest.count("/") > 2 and rest.startswith("/"):
        return _by_words(f"{inner}/{last}", name, unit)
    return None


def stated_unit(column: str) -> str:
    """The unit in brackets in a column's name, after its last space or underscore, or among its words; else empty."""
    bracket = _BRACKETS.search(column)
    text = (
        bracket.group(1)
        if bracket
        else re.split(r"[\s_]", column)[-1].rstrip("0123456789")
    )
    text = _COLUMN_UNITS.get(text.lower(), text)
    if text in SHARES or (len(text) > (not bracket) and fits(text, None)):
        return text
    parts = [part.rstrip("0123456789") for part in _split(_HUMPS[1].sub("_", column))]
    pairs = [
        _PER_SECOND.get(f"{first} {second}", "") for first, second in pairwise(parts)
    ]
    return next(
        filter(
            None, (*pairs, *(_UNITS.get(part, "") for part in parts if len(part) > 1))
        ),
        "",
    )


def spoken(column: str) -> list[str]:
    """The words of a name, but for single letters, in small letters."""
    return re.findall(r"[a-z]{2,}", _HUMPS[1].sub("_", column).lower())


def _by_words(text: str, name: str, unit: str) -> Meaning | None:
    kinds: list[str] = []
    weak: list[str] = []
    numbers: set[int] = set()
    roles: set[str] = {"joint"} if name else set()
    units: list[str] = []
    angle = _COLUMN_UNITS.get(unit.lower(), unit) in ("rad", "deg", "°")
    for word in _split(text):
        letters = word if word in _UNITS else _TRAILING_NUMBER.sub("", word)
        digits = word.removeprefix(letters)
        if digits:
            numbers.add(int(digits))
        if (
            letters in _UNITS
            and (len(letters) > 1 or not digits)
            and not (letters == "m" and not (kinds or weak))
        ):
            units.append(letters)
        elif letters == "a" and (angle or "joint" in roles):
            roles.add("joint")  # A1 is an axis
        elif (
            letters in _WEAK
            and not (letters == "d" and not (kinds or weak))
            and letters in _KIND_OF_WORD
        ):
            weak.append(_KIND_OF_WORD[letters])
            roles |= {_ROLES[letters]} if letters in _ROLES else set()
        elif letters in _KIND_OF_WORD:
            kinds.append(_KIND_OF_WORD[letters])
        elif not letters or letters in _ROLES:
            roles |= {_ROLES[letters]} if letters else set()
        else:
            return None
    return _joined(kinds or weak[:1], numbers, roles, units, name, unit)


def _split(text: str) -> Iterator[str]:
    """The words of a name; those of compounds such as ``jpos`` or ``sollwinkel`` one by one."""
    plain = (
        text.lower()
        .translate(_GREEK)
        .replace("q\u0307", "qdot")
        .replace("q\u0308", "qdd")
    )
    plain = re.sub(
        r"(?<![a-z])i_q(?![a-z])", "iq", re.sub("[\u0300-\u036f]", "", plain)
    )
    for word in re.findall(r"[a-z0-9°]+", plain):
        letters = word.rstrip("0123456789")
        cuts = [k for k in range(1, len(letters)) if _are_two(letters[:k], letters[k:])]
        yield from (
            [word]
            if letters in _KIND_OF_WORD or letters in _UNITS or not cuts
            else [word[: cuts[0]], word[cuts[0] :]]
        )


def _are_two(first: str, second: str) -> bool:
    """Whether two words stand together, as in ``jpos`` or ``qdeg``."""
    return (first in _PREFIXES and second in _STRONG) or (
        first in _KIND_OF_WORD and second in _ANGLES
    )


def _joined(
    kinds: list[str],
    numbers: set[int],
    roles: set[str],
    units: list[str],
    name: str,
    unit: str,
) -> Meaning | None:
    """The meaning of words together; None where they contradict each other."""
    reference = "reference" in roles
    if not kinds and ("state" in roles or reference) and (name or numbers):
        kinds = [
            "position"
        ]  # the vectors that LeRobot calls observation.state and action
    bare = (
        not kinds
        and roles <= _BARE
        and bool(units or roles - {"neutral"})
        and (bool(name) or bool(numbers))
    )
    kind = "joint" if bare else kinds[0] if kinds else ""
    kind = _RATES.get(kind, "") if "rate" in roles else kind
    by_second = _PER_SECOND.get(" ".join(units), "")
    stated = (
        [_COLUMN_UNITS.get(unit.lower(), unit) or by_second]
        if unit or by_second
        else [_UNITS[word] for word in units]
    )
    contradicting = (
        len(set(kinds)) > 1 or len(numbers) > 1 or len(stated) > 1 or (name and numbers)
    )
    if (
        not kind
        or contradicting
        or (reference and kind != "position")
        or (kind == "time" and numbers)
    ):
        return None
    if kind == "joint" and stated:
        kind = next(
            (k for k, units in _BY_UNIT.items() if fits(stated[0], units)), kind
        )
    index = next(iter(numbers), None)
    return Meaning(
        "reference" if reference else kind,
        name,
        index,
        "motor" in roles,
        stated[0] if stated else "",
    )


def without_prefix(names: Sequence[str], known: Iterable[str]) -> dict[str, str]:
    """Names without the words that all of them begin with, as those in one struct do, unless these say something."""
    shared = zip(min(names), max(names), strict=False) if names else ()
    whole = "".join(
        first for first, last in takewhile(lambda pair: pair[0] == pair[1], shared)
    )
    prefix = whole[: re.search(r"[^\W_]*$", whole).start()]  # type: ignore[union-attr]
    says = {part.rstrip("0123456789") for part in _split(prefix)} & (KNOWN - _NEUTRAL)
    if says or len(names) < 2 or any(_says(prefix, alias) for alias in known):
        return {name: name for name in names}
    return {name: name.removeprefix(prefix) for name in names}


def is_output(column: str) -> bool:
    """Whether a name says a force or a current, whatever else it says."""
    return bool(kinds_said(column) & {"output", "current"})


def may_be_output(column: str) -> bool:
    """Whether a name says a force or a current, or no other quantity and no command."""
    return is_output(column) or not kinds_said(column)


def kinds_said(column: str) -> set[str]:
    """The quantities that words in a name stand for, also where other words are not understood."""
    said = {
        part.rstrip("0123456789") for part in _split(_HUMPS[1].sub("_", column))
    } - (_WEAK - {"t"})
    return {words()[part] for part in said & words().keys()} | (
        {"reference"} if said & _COMMANDS else set()
    )


def words() -> dict[str, str]:
    """The words for quantities, with what they stand for."""
    return {**_KIND_OF_WORD, "temp": "temperature", "temperature": "temperature"}


_ATTACHED = re.compile(
    r"grip|finger|hand|thumb|claw|jaw|knuckle|tool|base|root|world|rail|track|wheel|caster|torso|lift|head|mobile|slide"
)
"""Parts of the names of joints that rest while an arm is identified."""
_NUMBER = re.compile(r"\d+(?=\D*$)")


def unlogged_joints(
    names: Sequence[str],
    meanings: Mapping[str, Meaning],
    known: Mapping[str, str],
    mechanism: Mechanism,
) -> list[tuple[str, ...]]:
    """Sets of motions that a log may lack; several where nothing tells which."""
    motions = mechanism.free_motions
    told = {
        name
        for alias, name in known.items()
        if any(_says(column, alias) for column in names)
    }
    said = {m.name for m in motions if told & {m.name, *m.positions, *m.velocities}}
    if said:
        kept = [said] if len(_other_names(names, known)) <= len(said) else []
    else:
        kept = next(
            filter(
                None,
                (list(_kept(mechanism, count)) for count in _counts(names, meanings)),
            ),
            [],
        )
    return [
        tuple(m.name for m in motions if m.name not in some)
        for some in kept
        if len(some) < len(motions)
    ]


def _other_names(names: Sequence[str], known: Mapping[str, str]) -> set[str]:
    """Words in the places of joints that no joint is called, as ``base angle`` beside ``elbow angle``."""
    told = [(name, alias) for name in names for alias in known if _says(name, alias)]
    patterns = {
        re.escape(name.replace(alias, "\0")).replace("\0", "(.+)")
        for name, alias in told
    }
    found = (
        re.fullmatch(pattern, name)
        for pattern in patterns
        for name in names
        if name not in dict(told)
    )
    return {match[1] for match in found if match is not None}


def _says(column: str, alias: str) -> bool:
    return (
        re.search(
            rf"(?<![A-Za-z0-9]){re.escape(alias)}(?![A-Za-z0-9])", column, re.IGNORECASE
        )
        is not None
    )


def _counts(names: Sequence[str], meanings: Mapping[str, Meaning]) -> list[int]:
    """Numbers of joints that columns may be of: of numbered positions, else the size of families of columns."""
    numbers = {
        said.index for said in meanings.values() if said.kind in ("position", "joint")
    } - {None}
    if numbers:
        return [len(numbers)]
    sizes = Counter(_NUMBER.sub("#", name) for name in names if _NUMBER.search(name))
    return [
        size for size, families in Counter(sizes.values()).most_common() if families > 1
    ]


def _kept(mechanism: Mechanism, count: int) -> Iterator[set[str]]:
    """Sets of motions that a log with columns of ``count`` joints may be of, the most plausible ones."""
    chains = _chains(mechanism)
    stems: dict[str, set[str]] = {}
    for name in chains:
        stems.setdefault(_NUMBER.sub("#", name), set()).add(name)
    found = [some for stem, some in stems.items() if "#" in stem and len(some) == count]
    found = found or [
        set(chain[start : start + count])
        for chain in chains.values()
        for start in range(len(chain))
    ]
    found = [
        some for some in found if len(some) == count and _rests(mechanism, chains, some)
    ]
    named = [
        sum(_ATTACHED.search(name.lower()) is not None for name in some)
        for some in found
    ]
    yield from (
        some
        for k, some in enumerate(found)
        if named[k] == min(named) and some not in found[:k]
    )


def _chains(mechanism: Mechanism) -> dict[str, list[str]]:
    """For every motion of a joint with one freedom, the motions of the joints from the base to it."""
    ways: dict[int, list[str]] = {GROUND: []}
    for k, body in enumerate(mechanism.bodies):
        own = [
            motion.name
            for motion in body.joint.motions
            if motion.name not in mechanism.dependent
        ]
        ways[k] = ways[body.parent] + own
    return {way[-1]: way for way in ways.values() if way}


def _rests(
    mechanism: Mechanism, chains: Mapping[str, Sequence[str]], kept: set[str]
) -> bool:
    """Whether all but some motions are of what is bolted to an arm, or on other branches."""
    along = {name for way in chains.values() if kept & set(way) for name in way}
    return all(
        motion.name in kept
        or motion.name not in along
        or _ATTACHED.search(motion.name.lower()) is not None
        or motion.kind is not MotionKind.ROTATION
        or len(body.joint.motions) > 1
        for body in mechanism.bodies
        for motion in body.joint.motions
    )
