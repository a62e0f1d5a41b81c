"""One judge: all hypotheses are scored by how well held-out blocks are predicted, and the best ones are taken.

Round after round the hypothesis that predicts best joins the model, until none is worth it.  Of those within one
standard error of the best the most usual one is taken, of these the one with the fewest columns.  A continuous change
is then made in earnest, with the size that the fit finds, until the size stands.

Other readings of the logs are judged by parameters of robots that can exist.  These are never better than free ones,
so that readings are tried in the order of free fits until that exceeds the best one found, and few programmes are
solved.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from math import exp, inf, log

import numpy as np

from echelon.base import BaseModel
from echelon.identification.advantage import Advantage
from echelon.identification.judge.changes import payloads, warming, whole_loads
from echelon.identification.judge.delays import scanned_delays
from echelon.identification.judge.effects import effects, friction_at_reversals
from echelon.identification.judge.evidence import (
    Evidence,
    OutputRows,
    Products,
    States,
    WeightedFit,
    fitted,
    ridged_solution,
)
from echelon.identification.judge.gains import own_gains
from echelon.identification.judge.held_out import Beside, HeldOut
from echelon.identification.judge.hypothesis import (
    CONTINUOUS,
    Kind,
    OtherReading,
    Term,
    Usual,
)
from echelon.identification.judge.knobs import delays, gain, load_of, slopes, turned
from echelon.identification.judge.readings import Readings
from echelon.identification.judge.settled import (
    Turned,
    jackknifed,
    read_with,
    settled,
    settled_with_loads,
)
from echelon.identification.physics.feasibility import nearest_physical
from echelon.shared import EchelonError, Floats

_ROUNDS = 8  # hypotheses that are taken at most
_SHOWN = 4  # of each round, hypotheses that are told beside the one that was taken
_SURE = 4.0  # standard errors of a gain from which on it is more than chance among some hundred hypotheses
_WORTH = 1.6e-3
"""Share of an output's squares that a hypothesis removes at least, times the root of the R² that it adds: a twentieth
of the squares where that adds a thousandth to R², half of them where it adds a hundred-thousandth."""
_READ = 0.3  # gain of another reading of the logs from which on it is taken: it leaves three quarters of residuals
_READ_ELSEWHERE = (
    0.7  # the same of a log that was not fitted, which may be of another day
)
_READ_ALIKE = 0.07  # differences of marks of readings up to which they do alike: 7 % of what is left
_RIVAL = (
    0.5  # of the best gain, from which on continuous changes are compared in earnest
)
_RARER = 3.0  # times _WORTH, for hypotheses that are rarely true
_NEW = 1e-4  # least share of a column that the model cannot say already
_PROGRAMMES = 16  # physical programmes that are solved at most
_LARGEST = 120  # base parameters beyond which physics is not asked: programmes of that size take seconds
_ALTERNATIVES = 2  # readings that are named together, because nothing tells them apart
_BESIDE_LATE = 2.0
"""Standard errors by which smooth friction is better than friction that is seen late: few are tried."""
_FLOOR = 1e-4  # of an output's spread: smaller residuals count as equal
_UNITS = (1e-3, 1e3)  # rates by that taken, where ms and s were confused
_RATES = (*np.geomspace(0.1, 10, 31), *_UNITS)  # that are tried first
_FINER_RATES = ((1.17, 9), (1.03, 9))  # then, how far from the best one, and how many
_OWN_GAINS = "the gains of outputs"
_SAME_RATE = 0.05  # relative difference from which on a rate is another one


@dataclass(frozen=True)
class Judged:
    """A hypothesis that was judged."""

    kind: Kind
    words: str
    write: str  # what a set-up says to state it, with {at} for places; empty where nothing states it
    usual: Usual
    gain: Advantage
    places: tuple[str, ...] = ()
    entries: tuple[str, ...] = ()  # what states it, by place
    before: tuple[float, ...] = ()  # R² on held-out rows, by place
    after: tuple[float, ...] = ()
    size: float = (
        1.0  # of a continuous change: times a rate, or the first of some gains
    )
    gravity: tuple[float, ...] | None = None  # that it finds, m/s² in the base frame
    delays: Mapping[str, float] = field(
        default_factory=dict
    )  # by output, s: all of them, where it finds some
    instead: str = ""  # type of effect whose place it takes
    alternatives: tuple[str, ...] = ()  # words of others that data do not tell from it
    taken: bool = True

    @property
    def shrinkage(self) -> float:
        """Per cent by which it makes residuals of all outputs smaller, as a geometric mean."""
        return 100 * (1 - exp(-self.gain.mean))


@dataclass(frozen=True)
class _Candidate:
    judged: Judged
    terms: tuple[Term, ...]
    left: Floats  # squares by block and output
    start: Floats | None = None  # sizes of a continuous change to start from
    columns: Mapping[int, list[int]] = field(
        default_factory=dict
    )  # of its terms, by their numbers in the trial
    trial: _Trial | None = None  # which it is from, if it is columns of the fit


@dataclass
class Judge:
    """Takes hypotheses into a model of some states, one after another."""

    base: BaseModel
    states: States
    readings: Readings
    doubtful: bool = True  # whether other readings are tried, each of which may take a physical programme
    only_reversals: bool = False  # whether nothing but friction at reversals is tried
    prior: Floats | None = (
        None  # base parameters that decide between readings that do alike
    )
    values: Floats | None = (
        None  # base parameters that are known, as of a log that was not fitted
    )
    gravity_is_open: bool = False  # whether nobody stated its direction, so that it is doubted before all else
    told: list[Judged] = field(
        default_factory=list, init=False
    )  # those that were taken, and the next best
    untested: list[str] = field(
        default_factory=list, init=False
    )  # words of hypotheses that the data did not let be tested, and why
    terms: list[Term] = field(
        default_factory=list, init=False
    )  # columns that were taken
    knobs: tuple[Turned, ...] = field(
        default=(), init=False
    )  # continuous ones that were taken
    turned: list[str] = field(
        default_factory=list, init=False
    )  # words of knobs that were tried in earnest

    def __post_init__(self) -> None:
        self.evidence = Evidence(self.base)
        self.start = self.states

    @property
    def is_told(self) -> bool:
        """Whether some output varies in rows that move, so that there is anything to judge."""
        return bool((self.evidence.products(self.states).spread > 0).any())

    def run(self) -> list[Judged]:
        """Hypotheses that are taken, in their order; :attr:`told` has others beside them."""
        if self.only_reversals:
            smooth = self._at_reversals()
            self.told = [] if smooth is None else [smooth.judged]
            return list(self.told)
        taken: list[_Candidate] = []
        others: list[list[Judged]] = []
        while len(taken) < _ROUNDS:
            small, sure = self._small()
            beside = _beside(small, sure)
            large = None
            if not taken:
                large = self.other_reading() if self.doubtful else self._other_robot()
            if large is not None and (
                small is None or not self._does_as_well(small, large[0])
            ):
                self.told = [large[0], *beside]
                return [
                    large[0]
                ]  # what is left then is judged when the set-up is mended
            if not taken and _may_be_friction(small):
                smooth = self._at_reversals()
                small = small if smooth is None else smooth
            if small is None:
                break
            if small.judged.kind in CONTINUOUS:
                small = self._rival(small, sure)
                beside = _beside(small, sure)
            if self._takes(small):
                taken.append(small)
                others.append(beside)
        kept = [self._keeps(some) for some in taken]
        said = list(compress(self._said(taken), kept))
        self.told = [
            some
            for one, beside in zip(said, compress(others, kept), strict=True)
            for some in (one, *beside)
        ]
        if taken and self.states.drives is None:  # what was taken may have hidden it
            robot = self._other_robot()
            if robot is not None:
                said.append(robot[0])
                self.told.append(robot[0])
        return said

    def _does_as_well(self, small: _Candidate, large: Judged) -> bool:
        """Whether columns of the fit explain as much as another reading of the logs, or a robot that can exist does."""
        if small.judged.gain.mean >= large.gain.mean:
            return True
        before, after = self._physical(self.states), None
        if small.judged.kind in (
            Kind.GAIN,
            Kind.DELAY,
        ):  # whose slopes say little of what is far from none
            after = self._physical(self._settled(small)[1])
        return (
            before is not None
            and after is not None
            and _between(before, after).mean > large.gain.mean - _READ_ALIKE
        )

    # -- columns -------------------------------------------------------------------------------------------------

    def _small(self) -> tuple[_Candidate | None, list[_Candidate]]:
        """The best hypothesis that is columns of the fit, and all that gain surely."""
        model, first = self._fit(self.states)
        values = first.values[: self.base.rank]
        tried = [
            *effects(
                self.base.mechanism,
                self.states,
                self.states.predicted(self.base, values),
            ),
            *payloads(self.base, self.states),
            *warming(self.base, self.states),
            *turned(self.readings, self.states, values),
        ]
        tried = [term for term in tried if term.words not in self.turned]
        held = HeldOut(model, first.noise)
        rows = list(self.evidence.rows(self.states, self._signals))
        found = []
        for terms in _grouped(tried):
            candidate = self._candidate(terms, held, rows)
            if candidate is not None:
                found.append(candidate)
        far = self._far(model, first, held, rows)
        words = {some.terms[0].words for some in far}
        found = [*(some for some in found if some.terms[0].words not in words), *far]
        sure = [c for c in found if c.judged.gain.ratio > _SURE]
        if not sure:
            return None, []
        best = max(sure, key=lambda c: c.judged.gain.mean)
        alike = [
            c
            for c in sure
            if c is best or Advantage.of(c.left, best.left, _floor(model)).is_none
        ]
        chosen = min(alike, key=self._simple)
        if (
            chosen.judged.kind is Kind.GAIN and self.prior is not None
        ):  # of two outputs either may be wrong
            gains = [c for c in alike if c.judged.kind is Kind.GAIN]
            chosen = (
                min(gains, key=lambda c: self._unlike_prior(c, model))
                if len(gains) > 1
                else chosen
            )
        return _of_position(_pruned(chosen), alike), sure

    def _at_reversals(self) -> _Candidate | None:
        """Smooth friction in place of Coulomb friction, unless friction that is seen late explains as much.

        The rows reach beyond the band of the fit, in which reversals hardly show.
        """
        if not self.states.reversals or self.states.drives is not None:
            return None
        states = self.states.unfiltered
        rows = list(self.evidence.rows(states))
        products = self.evidence.products(states)
        fit = fitted(products)
        held = HeldOut(products, fit.noise)
        tried = friction_at_reversals(self.base, states, fit.values)
        trials = []
        for terms in _grouped(list(tried)):
            signals = [term.signals for term in terms]
            trials.append(_Trial(terms, held, Beside(held, rows, states, signals)))
        found = [
            candidate
            for trial in trials
            if trial.terms[0].instead
            and (candidate := trial.candidate(trial.columns)) is not None
            and candidate.judged.gain.ratio > _SURE
        ]
        if not found:
            return None
        best = max(found, key=lambda some: some.judged.gain.mean)
        for trial in trials:
            if trial.terms[0].instead:
                continue
            columns = [
                column
                for term, some in trial.columns.items()
                if trial.terms[term].place in best.judged.places
                for column in some
            ]
            late = trial.beside.squares(columns)
            gain = Advantage.of(late, best.left, _floor(products))
            if gain.is_none or gain.ratio < _BESIDE_LATE:
                return None
        return best

    def _unlike_prior(self, some: _Candidate, model: Products) -> float:
        """Spread of the ratios of outputs to what the prior predicts, in logarithms, once gains are taken off."""
        assert self.prior is not None
        prior = np.append(self.prior, np.zeros(model.size - self.base.rank))
        ratios = np.full(len(model.grams), np.nan)
        for output, (columns, gram) in enumerate(
            zip(model.columns, model.together().grams, strict=True)
        ):
            predicted, whole = prior[columns], gram[0]
            ratio = (predicted @ whole[:-1, -1]) / max(
                predicted @ whole[:-1, :-1] @ predicted, _TINY
            )
            if ratio > 0:
                ratios[output] = log(ratio)
        sizes = self._settled(some)[0][-1].sizes
        names = [output.name for output in self.base.mechanism.outputs]
        ratios[[names.index(name) for name in some.judged.places]] -= sizes
        told = ratios[np.isfinite(ratios)]
        return float(told.std()) if len(told) else inf

    def _rival(self, chosen: _Candidate, sure: Sequence[_Candidate]) -> _Candidate:
        """The continuous change that leaves least in earnest, with those that leave as little: derivatives mislead."""
        least = _RIVAL * chosen.judged.gain.mean
        rivals = [
            c
            for c in sure
            if c.judged.kind in CONTINUOUS and c.judged.gain.mean > least
        ]
        others = [c for c in rivals if c.terms[0].words != chosen.terms[0].words]
        if not others:
            return chosen
        settled_ones = [
            (some, self._marks_of(self._settled(some)[1])) for some in (chosen, *others)
        ]
        _, best = min(settled_ones, key=lambda entry: float(entry[1].mean()))
        alike = [some for some, marks in settled_ones if _between(marks, best).is_none]
        by_prior = chosen.judged.kind is Kind.GAIN and self.prior is not None
        first = chosen if by_prior else min(alike, key=self._simple)
        places = set(first.judged.places)
        rest = [
            c
            for c in alike
            if c.judged.kind is not first.judged.kind
            or not places & set(c.judged.places)
        ]
        rest.sort(key=lambda c: -c.judged.gain.mean)
        words = tuple(c.judged.words for c in rest[: _ALTERNATIVES - 1])
        return replace(first, judged=replace(first.judged, alternatives=words))

    def _marks_of(self, states: States) -> Floats:
        """Marks of the model with the columns that were taken, in some states."""
        products, fit = self._fit(states)
        return _marks(products, fit.values)

    def _simple(self, some: _Candidate) -> tuple[bool, Usual, int, float]:
        """Order of hypotheses that predict alike, the simplest one first."""
        stated = not (self.gravity_is_open and some.judged.kind is Kind.GRAVITY)
        return (
            stated,
            some.judged.usual,
            sum(term.width for term in some.terms),
            -some.judged.gain.mean,
        )

    def _far(
        self,
        model: Products,
        fit: WeightedFit,
        held: HeldOut,
        rows: Sequence[OutputRows],
    ) -> list[_Candidate]:
        """Gains and delays that are too far from none for derivatives."""
        values, found = fit.values[: self.base.rank], []
        gains: dict[int, float] = {}
        if _OWN_GAINS not in self.turned:
            gains, self.untested = own_gains(self.base, model)
        if gains:  # as of outputs in other units, such as currents
            names = [self.readings.outputs[output] for output in gains]
            knob = gain(
                list(gains),
                names,
                [float(np.sign(factor)) for factor in gains.values()],
            )
            start = np.log(np.abs(list(gains.values())))
            signals = slopes(
                self.base,
                self.states,
                values,
                knob,
                np.zeros(len(gains)),
                np.zeros_like(self.states.y),
            )
            term = Term(
                Kind.GAIN,
                _OWN_GAINS,
                ", ".join(names),
                "",
                Usual.OFTEN,
                signals,
                knob,
            )
            found.append(self._started(term, start, held, list(gains)))
        if not self.knobs:  # a long delay hides all else, and is the first to be found
            terms = delays(self.readings, self.states, values)
            for term, delay in zip(
                terms, scanned_delays(rows, self.states), strict=False
            ):
                if delay:
                    found.append(self._started(term, np.array([delay]), held))
        return [some for some in found if some.terms[0].words not in self.turned]

    def _started(
        self, term: Term, start: Floats, held: HeldOut, outputs: Sequence[int] = ()
    ) -> _Candidate:
        """A continuous change at a size to start from; ``outputs`` are its places, if it has several."""
        assert term.knob is not None
        model, fit = self._fit(
            term.knob.moved(self.states, start, np.zeros_like(self.states.y))
        )
        rows = held.products.counts / np.maximum(model.counts, 1)
        after = rows * HeldOut(model, fit.noise).squares
        judged = _judged((term,), held, after, outputs)
        names = tuple(self.readings.outputs[k] for k in outputs) or (term.place,)
        entries = ("",) * len(names)
        judged = replace(judged, write="", places=names, entries=entries)
        return _Candidate(judged, (term,), after, start)

    def _takes(self, chosen: _Candidate) -> bool:
        """Takes a hypothesis into the model, unless it gains nothing where it is not a derivative any more."""
        if chosen.terms[0].knob is None:
            self.terms += chosen.terms
            return True
        self.turned.append(chosen.terms[0].words)
        knobs, states = self._settled(chosen)
        last = knobs[-1]
        told = np.abs(last.sizes) > np.maximum(_SURE * last.errors, last.knob.least)
        if not told.any():  # an output of pure noise has no gain
            return False
        (before, old), (after, new) = self._fit(self.states), self._fit(states)
        gain = _between(_marks(before, old.values), _marks(after, new.values))
        if gain.is_none or gain.ratio < _SURE:
            return False
        self.knobs, self.states = knobs, states
        return True

    def _keeps(self, some: _Candidate) -> bool:
        """Gives up the columns of a hypothesis, unless it explains what those that were taken after it leave.

        Smooth friction stays, since it shows beyond the band.
        """
        if some.terms[0].knob is not None or some.terms[0].instead:
            return True
        others = [
            term for term in self.terms if all(term is not mine for mine in some.terms)
        ]
        products = self.evidence.products(
            self.states, [term.signals for term in others]
        )
        held = HeldOut(products, fitted(products).noise)
        rows = list(self.evidence.rows(self.states, [term.signals for term in others]))
        again = self._candidate(some.terms, held, rows)
        if again is not None and again.judged.gain.ratio > _SURE:
            return True
        self.terms = others
        return False

    def _candidate(
        self, terms: Sequence[Term], held: HeldOut, rows: Sequence[OutputRows]
    ) -> _Candidate | None:
        """A hypothesis beside a model with some rows, at the places where it matters; None if there are none."""
        signals = [term.signals for term in terms]
        trial = _Trial(terms, held, Beside(held, rows, self.states, signals))
        return trial.candidate(trial.columns)

    def _said(self, taken: Sequence[_Candidate]) -> list[Judged]:
        """Hypotheses that were taken, those that are continuous with the sizes that were found in the end."""
        if self.knobs:
            found = settled_with_loads(self.base, self.start, self.knobs, self._left)
            self.knobs = jackknifed(
                self.base, self.start, found, self.evidence, self._signals
            )
            self.states = read_with(self.start, self.knobs)
        knobs = iter(self.knobs)
        judged = (some.judged for some in taken)
        return [
            self._sized(some, next(knobs)) if some.kind in CONTINUOUS else some
            for some in judged
        ]

    def _sized(self, judged: Judged, turned: Turned) -> Judged:
        words, write = turned.words
        if judged.alternatives:
            words += f"; these data cannot distinguish it from {' or '.join(judged.alternatives)}"
        gravity, delays = None, {}
        if judged.kind is Kind.DELAY:
            delays = self.readings.all_delays(np.asarray(self.states.late))
            write = f"delays: {{{', '.join(f'{name}: {delay:.4g}' for name, delay in delays.items())}}}"
        if judged.kind is Kind.GRAVITY and self.states.gravity is not None:
            gravity = tuple(self.states.gravity.tolist())
        scaled = judged.kind in (Kind.GAIN, Kind.RATE)
        size = turned.knob.sign * float(np.exp(turned.sizes[0])) if scaled else 1.0
        return replace(
            judged, words=words, write=write, size=size, gravity=gravity, delays=delays
        )

    def _settled(self, chosen: _Candidate) -> tuple[tuple[Turned, ...], States]:
        """All knobs that were taken and another one, with the sizes that leave least, and the states read with them."""
        knob = chosen.terms[0].knob
        assert knob is not None
        sizes = np.zeros(knob.count) if chosen.start is None else chosen.start
        load = load_of(
            self.base,
            self.states,
            self._fit(self.states)[1].values[: self.base.rank],
            knob,
        )
        another = Turned(knob, sizes, np.zeros(knob.count), load)
        turned, _ = settled(self.base, self.start, [*self.knobs, another], self._left)
        return turned, read_with(self.start, turned)

    def _left(
        self, states: States, columns: Sequence[Mapping[int, Floats]]
    ) -> tuple[float, WeightedFit]:
        """Logarithm of the residuals of the model with the columns that were taken and some others, and its fit."""
        products = self.evidence.products(states, [*self._signals, *columns])
        found = fitted(products)
        return float(_marks(products, found.values).mean()), found

    def _fit(self, states: States) -> tuple[Products, WeightedFit]:
        products = self.evidence.products(states, self._signals)
        return products, fitted(products)

    @property
    def _signals(self) -> list[Mapping[int, Floats]]:
        """Columns that were taken."""
        return [term.signals for term in self.terms]

    # -- readings ------------------------------------------------------------------------------------------------

    def other_reading(
        self, *, only_clock: bool = False
    ) -> tuple[Judged, OtherReading] | None:
        """The reading of the logs with which a robot that can exist explains far more, if there is one."""
        before = self._physical(self.states)
        tried = (
            self._clocks() if only_clock else (*self.readings.all(), *self._clocks())
        )
        if before is None:
            return None
        return self._best_reading(before, self._programmes(tried, float(before.mean())))

    def _other_robot(self) -> tuple[Judged, OtherReading] | None:
        """Another direction of gravity, or coupled drives, with which free parameters explain far more."""
        products, fit = self._fit(self.states)
        tried = [
            (marks, some)
            for some in self.readings.of_robot()
            if (marks := self._free(some)) is not None
        ]
        return self._best_reading(_marks(products, fit.values), tried)

    def _best_reading(
        self, before: Floats, found: Sequence[tuple[Floats, OtherReading]]
    ) -> tuple[Judged, OtherReading] | None:
        """The best of some readings, given with their marks, if it does far better than the present one."""
        if not found:
            return None
        best = min((marks for marks, _ in found), key=lambda marks: float(marks.mean()))
        gain = _between(before, best)
        if (
            gain.mean < (_READ if self.values is None else _READ_ELSEWHERE)
            or gain.ratio < _SURE
        ):
            return None
        alike = [
            reading
            for marks, reading in found
            if marks is best or _between(marks, best).is_none
        ]
        most = min(reading.usual for reading in alike)
        turned = [
            reading
            for reading in alike
            if self.gravity_is_open and reading.gravity is not None
        ]
        alike = turned or self._likely(
            [reading for reading in alike if reading.usual == most]
        )
        if len(alike) > _ALTERNATIVES:
            return None
        words = ", or ".join(reading.words for reading in alike)
        shares = (exp(before.mean()), exp(best.mean()))
        judged = Judged(
            Kind.READING,
            words,
            "",
            most,
            gain,
            before=shares[:1],
            after=shares[1:],
            size=alike[0].rate,
        )
        reading = alike[0]
        if len(alike) > 1 or reading.gravity is None:
            return judged, reading
        return replace(judged, gravity=tuple(reading.gravity.tolist())), reading

    def _programmes(
        self, tried: Iterable[OtherReading], before: float
    ) -> list[tuple[Floats, OtherReading]]:
        """Readings with the marks of physical parameters, those that could be the best."""
        free = [
            (marks.mean(), reading)
            for reading in tried
            if (marks := self._free(reading)) is not None
        ]
        free.sort(
            key=lambda entry: round(float(entry[0]), 2)
        )  # of equal ones those that happen more often come first
        best, found = before - _READ, []
        for mark, reading in free[:_PROGRAMMES]:
            if mark > best + _READ_ALIKE:
                break
            marks = self._physical(reading.read(self.states))
            if marks is not None:
                found.append((marks, reading))
                best = min(best, float(marks.mean()))
        return found

    def _likely(self, alike: list[OtherReading]) -> list[OtherReading]:
        """Readings with which the prior predicts best: a mirrored robot can exist as well."""
        if self.prior is None or len(alike) < 2:
            return alike
        products = [
            self.evidence.products(reading.read(self.states)) for reading in alike
        ]
        marks = [float(_marks(some, self.prior).mean()) for some in products]
        return [
            reading
            for mark, reading in zip(marks, alike, strict=True)
            if mark <= min(marks) + _READ_ALIKE
        ]

    def _clocks(self) -> Iterator[OtherReading]:
        """The rate that explains most, if it is not the one that was taken."""

        def mark(rate: float) -> float:
            found = self._free(self.readings.clock(rate))
            return inf if found is None else float(found.mean())

        rate = min(map(float, _RATES), key=mark)
        for width, count in _FINER_RATES if rate not in _UNITS else ():
            rate = min(
                (float(some) for some in rate * width ** np.linspace(-1, 1, count)),
                key=mark,
            )
        if abs(log(rate)) > _SAME_RATE:
            yield self.readings.clock(rate)

    def _free(self, reading: OtherReading) -> Floats | None:
        """Marks of any parameters; None where nothing can be told, as with loops that do not close."""
        try:
            products, fit = self._fit(reading.read(self.states))
        except EchelonError:
            return None
        return _marks(products, self._known(fit.values))

    def _physical(self, states: States) -> Floats | None:
        """Marks of parameters of the nearest robot that can exist; None where none is found."""
        try:
            products, fit = self._fit(states)
            values, rank = fit.values.copy(), self.base.rank
            if self.values is None and rank <= _LARGEST:
                covariance = fit.covariance[:rank, :rank]
                standard, _ = nearest_physical(
                    self.base, values[:rank], covariance, states.symbols
                )
                values[:rank] = self.base.B_float(states.symbols) @ standard
        except (EchelonError, np.linalg.LinAlgError):
            return None
        return _marks(products, self._known(values))

    def other_load(self) -> str | None:
        """The body that carries another load than in the logs whose parameters are known, if that explains far more."""
        if self.values is None:
            return None
        rank, found = self.base.rank, []
        for term in whole_loads(self.base, self.states):
            products = self.evidence.products(self.states, [term.signals])
            without = np.append(self.values, np.zeros(term.width))
            noise = products.squares(without).sum(axis=0) / np.maximum(
                products.counts.sum(axis=0), 1
            )
            matrix, right = products.together().normal_equations(
                1 / np.maximum(noise, _TINY)
            )
            load = ridged_solution(
                matrix[rank:, rank:], right[rank:] - matrix[rank:, :rank] @ self.values
            )
            gain = _between(
                _marks(products, without),
                _marks(products, np.append(self.values, load)),
            )
            found.append((gain, term.words))
        gain, words = max(
            found, key=lambda entry: entry[0].mean, default=(Advantage(0.0, inf), "")
        )
        return words if gain.mean > _READ_ELSEWHERE and gain.ratio > _SURE else None

    def _known(self, values: Floats) -> Floats:
        if self.values is None:
            return values
        return np.append(self.values, values[self.base.rank :])


@dataclass(frozen=True)
class _Trial:
    """Terms of the same words beside a model."""

    terms: Sequence[Term]
    held: HeldOut
    beside: Beside

    @property
    def columns(self) -> dict[int, list[int]]:
        """Numbers of the columns of each term."""
        found, first = {}, 0
        for number, term in enumerate(self.terms):
            found[number] = list(range(first, first + term.width))
            first += term.width
        return found

    @property
    def spread(self) -> Floats:
        """Squares of measured values about their means, shape (outputs,)."""
        return self.held.products.spread

    def candidate(self, columns: dict[int, list[int]]) -> _Candidate | None:
        """A hypothesis at the places where it matters, given by columns of its terms; None if there are none."""
        columns = {
            term: [c for c in some if self.beside.new[c] > _NEW]
            for term, some in columns.items()
        }
        columns = {
            term: some
            for term, some in columns.items()
            if some and self._can_be(self.terms[term], some)
        }
        before = after = self.held.squares
        while columns:
            after = self.beside.squares([c for some in columns.values() for c in some])
            worth = {
                term: some
                for term, some in columns.items()
                if self._is_worth(self.terms[term], before, after)
            }
            if len(worth) == len(columns):
                break
            columns = worth
        if not columns:
            return None
        terms = tuple(self.terms[term] for term in columns)
        judged = _judged(terms, self.held, after)
        return _Candidate(judged, terms, after, columns=columns, trial=self)

    def pruned(self, chosen: _Candidate) -> _Candidate:
        """A hypothesis at those of its places that matter beside the others."""
        columns = dict(chosen.columns)
        for term in chosen.columns if len(columns) > 1 else ():
            others = [
                c for other, some in columns.items() if other != term for c in some
            ]
            if others and not self._is_worth(
                self.terms[term], self.beside.squares(others), chosen.left
            ):
                del columns[term]
        kept = self.candidate(columns) if len(columns) < len(chosen.columns) else None
        return kept or chosen

    def _can_be(self, term: Term, columns: list[int]) -> bool:
        low, high = term.sizes
        sizes = self.beside.sizes(columns)
        return bool(((low < sizes) & (sizes < high)).all())

    def _is_worth(self, term: Term, before: Floats, after: Floats) -> bool:
        least = _WORTH * (_RARER if term.usual is Usual.RARELY else 1.0)
        for output in _shown(term, before):
            old = before[:, output].sum()
            new = after[:, output].sum()
            spread = self.spread[output]
            if (
                new < old
                and new < spread
                and (old - new) / old * np.sqrt((old - new) / spread) > least
            ):
                return True
        return False


_TINY = np.finfo(float).tiny


def _floor(products: Products) -> Floats:
    """Squares that count as none, shape (outputs,)."""
    return _FLOOR**2 * products.spread


def _judged(
    terms: Sequence[Term], held: HeldOut, after: Floats, outputs: Sequence[int] = ()
) -> Judged:
    """Terms as a hypothesis, by what they leave of blocks and outputs, told by the outputs in which they show most."""
    before, spread = held.squares, np.maximum(held.products.spread, _TINY)
    gains = (before - after).sum(axis=0) / spread
    told = outputs or [max(_shown(t, before), key=gains.__getitem__) for t in terms]
    old, new = (
        tuple((1 - squares[:, told].sum(axis=0) / spread[told]).tolist())
        for squares in (before, after)
    )
    first, entries = terms[0], tuple(term.write for term in terms)
    return Judged(
        first.kind,
        first.words,
        entries[0],
        first.usual,
        Advantage.of(before, after, _floor(held.products)),
        tuple(term.place for term in terms),
        entries,
        old,
        new,
        instead=first.instead,
    )


def _may_be_friction(small: _Candidate | None) -> bool:
    """Whether residuals may be of smooth friction: they follow nothing in the band, or an effect of few robots."""
    if small is None:
        return True
    judged = small.judged
    return judged.kind is Kind.EFFECT and judged.usual is not Usual.EVERYWHERE


def _pruned(chosen: _Candidate) -> _Candidate:
    return chosen if chosen.trial is None else chosen.trial.pruned(chosen)


def _shown(term: Term, squares: Floats) -> Iterable[int]:
    """Outputs in which a term may show: what is read otherwise moves parameters that all outputs share."""
    if term.kind is Kind.GAIN:
        return range(squares.shape[1])
    return term.signals


def _of_position(chosen: _Candidate, alike: Sequence[_Candidate]) -> _Candidate:
    """Functions of a joint's position that nothing tells apart are some function of it."""
    places = set(chosen.judged.places)
    same = [
        c for c in alike if c.terms[0].of_position and places <= set(c.judged.places)
    ]
    if (
        chosen.judged.usual is not Usual.RARELY
        or not chosen.terms[0].of_position
        or len(same) < _ALTERNATIVES
    ):
        return chosen
    words = f"an effect of the position, such as {chosen.judged.words}"
    return replace(chosen, judged=replace(chosen.judged, words=words))


def _beside(chosen: _Candidate | None, sure: Iterable[_Candidate]) -> list[Judged]:
    """Hypotheses that do well beside the one that is taken, the best ones first."""
    others = [
        c.judged
        for c in sure
        if chosen is None or c.terms[0].words != chosen.terms[0].words
    ]
    return [
        replace(some, taken=False)
        for some in sorted(others, key=lambda some: -some.gain.mean)[:_SHOWN]
    ]


def _marks(products: Products, values: Floats) -> Floats:
    """Logarithms of residuals over spread, by block, means of the outputs; shape (blocks,)."""
    told = products.spread > 0
    shares = (
        products.squares(values)[:, told] * len(products.counts) / products.spread[told]
    )
    return np.asarray(0.5 * np.log(np.maximum(shares, _FLOOR**2)).mean(axis=1))


def _between(before: Floats, after: Floats) -> Advantage:
    return Advantage.of_blocks(before - after)


def _grouped(tried: Sequence[Term]) -> list[list[Term]]:
    """Terms of the same words together."""
    found: dict[str, list[Term]] = {}
    for term in tried:
        found.setdefault(term.words, []).append(term)
    return list(found.values())
