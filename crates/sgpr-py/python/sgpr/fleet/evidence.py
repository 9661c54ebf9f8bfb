"""When did the level of a parameter jump? Evidence that grows session by session.

A session measures a level with an error that has Student's t distribution. The level wanders as wear makes it, and
once in a while it jumps. Levels form a grid, so that all probabilities are sums: `quiet` is the joint probability of
what was seen so far and of each level if nothing jumped, and `jumped` the same if there was a jump, summed over all
sessions at which it can have been. Their ratio is the statistic of Shiryaev and Roberts: if nothing jumps, its mean
grows by one each session, whatever the number of tests, so that a limit of A is passed once in A sessions or less
often. One ratio for each parameter of an arm, all m of them against the limit m A, keeps that for the arm: their mean
grows by one as well.

Scatter is known but for a factor, which is another sum; how probable its values are, and how heavy the tails, are
what makes the sessions of all arms of a type most probable (empirical Bayes).

Source: M. Pollak, Average run lengths of an optimal method of detecting a change in distribution, Ann. Statist. 15
(1987); J. Shin, A. Ramdas, A. Rinaldo, E-detectors, New England J. Statist. Data Sci. 2 (2024), for the mean of
several.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEP = 0.4
"""Spacing of levels in deviations of a session, in reach of scatter and wear ..."""
FINE = 10.0
"""... up to here, beyond in equal ratios ..."""
FARTHEST, COARSE = 3000.0, 12
"""... up to here, in so many steps to either side."""
JUMP = 5.0
"""Jumps are about this large, in deviations of a session: scale of a Cauchy distribution."""
FACTORS = np.sqrt(2.0) ** np.arange(-1, 4)
"""Factors on the scatter ..."""
FREEDOMS = (4, 8, 30)
"""... and degrees of freedom, even numbers, among which the sessions choose, at most so many of each track."""
MOST_TO_CHOOSE = 200
FEWEST_AFTER = 2
"""Sessions after a jump without which it is none: one alone is an event."""
SHOWN = np.geomspace(0.5, 500.0, 31)
"""Changes, in deviations of a session, among which the smallest is looked for that two sessions show."""
MOST_STEPS = 60
"""Steps to neighbours in which a level wanders from one session to the next, each half of the square of `STEP`."""
FEWEST_TO_CENTRE = 10
LARGEST = 600.0
"""Logarithm of a ratio that is beyond any limit, and whose inverse and sums are still numbers."""


@dataclass
class Track:
    """A parameter over sessions.

    - `value`, and the standard deviation `std` that its session gives it
    - `wander`: variance of what it may change by before each session without being broken
    - `kind`: tracks of one kind are alike in their scatter
    - `limit`: of the ratio
    """

    value: Array
    std: Array
    wander: Array
    kind: str
    limit: float


@dataclass
class Found:
    """What a track shows.

    - `ratio`: of Shiryaev and Roberts, `(sessions,)`; it begins anew after each jump
    - `jumps`: sessions at which the level jumped, and `told`: those after which that was sure
    - `freedom`: degrees of freedom of the tails; `factor`: mean factor on the standard deviations
    - `shows`: smallest change that two more sessions, such as the median one, would be sure of
    """

    ratio: Array
    jumps: list[int] = field(default_factory=list)
    told: list[int] = field(default_factory=list)
    freedom: int = FREEDOMS[-1]
    factor: float = 1.0
    shows: float = math.inf


def find_jumps(tracks: Sequence[Track]) -> list[Found]:
    """The jumps of tracks: parameters of arms of one type."""
    evidence = {freedom: _Trellis(tracks, MOST_TO_CHOOSE).evidence(freedom) for freedom in FREEDOMS}
    chosen: dict[str, tuple[float, Array, int]] = {}
    for kind in dict.fromkeys(track.kind for track in tracks):
        own = [k for k, track in enumerate(tracks) if track.kind == kind]
        choices = [(*_mixture(of_all[own]), freedom) for freedom, of_all in evidence.items()]
        chosen[kind] = max(choices, key=lambda choice: choice[0])
    found: dict[int, Found] = {}
    for freedom in FREEDOMS:
        places = [k for k, track in enumerate(tracks) if chosen[track.kind][2] == freedom]
        if places:
            of_kind: list[Track] = [tracks[k] for k in places]
            prior = np.array([chosen[track.kind][1] for track in of_kind])
            found.update(zip(places, _Trellis(of_kind).run(freedom, prior), strict=True))
    return [found[k] for k in range(len(tracks))]


def _mixture(evidence: Array) -> tuple[float, Array]:
    """How probable factors are that make all tracks most probable, and that probability, logarithm.

    - `evidence`: logarithm, `(tracks, factors)`
    """
    share = np.full(evidence.shape[1], 1.0 / evidence.shape[1])
    top = evidence.max(axis=1, keepdims=True)
    likelihood = np.exp(evidence - top)
    for _ in range(50):
        weight = share * likelihood
        weight /= weight.sum(axis=1, keepdims=True)
        # As if one more arm had all factors alike: a few arms do not tell that none is possible.
        share = (weight.sum(axis=0) + 1.0 / len(share)) / (len(evidence) + 1.0)
    return float(np.sum(np.log(likelihood @ share) + top[:, 0])), share


class _Trellis:
    """Levels by sessions, for all tracks at once; each in units of its own."""

    def __init__(self, tracks: Sequence[Track], most: int | None = None) -> None:
        self.tracks = tracks
        self.lengths = [len(track.value[:most]) for track in tracks]
        shape = len(tracks), max(self.lengths)
        # Behind the end of a track there is nothing to see: deviations without end.
        self.z, self.spread, self.std = np.zeros(shape), np.zeros(shape), np.full(shape, np.inf)
        self.unit = [float(np.median(track.std)) for track in tracks]
        for k, (track, length) in enumerate(zip(tracks, self.lengths, strict=True)):
            unit = self.unit[k]
            centre = float(np.median(track.value[:FEWEST_TO_CENTRE]))
            self.z[k, :length] = (track.value[:length] - centre) / unit
            self.std[k, :length] = track.std[:length] / unit
            self.spread[k, :length] = track.wander[:length] / unit**2
        self.level = _levels()
        self.jump = _jump_probabilities(self.level)

    def evidence(self, freedom: int) -> Array:
        """Logarithm of the probability of each track with each factor, `(tracks, factors)`, at most one jump in it."""
        rare = 1.0 / np.array([track.limit for track in self.tracks])[:, None]
        state = _State(np.ones((len(self.tracks), len(FACTORS))), len(self.level))
        for k in range(self.z.shape[1]):
            self._advance(state, k, freedom)
        return np.asarray(state.log + np.logaddexp(np.log(state.quiet.sum(axis=2)), np.log(rare) + state.lift))

    def run(self, freedom: int, prior: Array) -> list[Found]:
        """Session by session, with a new start after each jump.

        - `prior`: probability of the factors, `(tracks, factors)`
        """
        tracks, length = self.z.shape
        limits = np.array([track.limit for track in self.tracks])
        found = [Found(np.zeros(own), freedom=freedom) for own in self.lengths]
        state = _State(prior, len(self.level))
        starts = [0] * tracks
        for k in range(length):
            fresh = self._advance(state, k, freedom)
            weight = np.exp(state.log - state.log.max(axis=1, keepdims=True))
            quiet = (weight * state.quiet.sum(axis=2)).sum(axis=1)
            # A jump of which only one session is seen does not count yet.
            ratio = (weight * (np.exp(np.minimum(state.lift, LARGEST)) - fresh)).sum(axis=1) / quiet
            for track, one in enumerate(found):
                if k >= self.lengths[track]:
                    continue
                one.ratio[k] = ratio[track]
                if ratio[track] >= limits[track]:
                    place = self._place(track, starts[track], k, freedom, state.prior[track])
                    one.jumps.append(place)
                    one.told.append(k)
                    starts[track] = place
                    self._restart(state, track, place, k, freedom)
        final = np.exp(state.log - state.log.max(axis=1, keepdims=True)) * state.quiet.sum(axis=2)
        shows = self._shows(state, freedom, limits)
        for track, one in enumerate(found):
            one.factor = float(final[track] @ FACTORS / final[track].sum())
            one.shows = float(shows[track]) * self.unit[track]
        return found

    def _shows(self, state: "_State", freedom: int, limits: Array) -> Array:
        """The smallest of `SHOWN` that takes the ratio of each track beyond its limit in two sessions."""
        weight = np.exp(state.log - state.log.max(axis=1, keepdims=True))[:, :, None]
        quiet = weight * state.quiet
        jumped = quiet @ self.jump
        mean = (quiet.sum(axis=1) @ self.level) / quiet.sum(axis=(1, 2))
        smallest = np.full(len(mean), math.inf)
        for change in SHOWN[::-1]:
            both = self._density((mean + change)[:, None, None], FACTORS[None, :, None], freedom) ** FEWEST_AFTER
            ratio = (jumped * both).sum(axis=(1, 2)) / (quiet * both).sum(axis=(1, 2))
            smallest[ratio >= limits] = change
        return smallest

    def _likelihood(self, k: int, freedom: int, tracks: slice | int = slice(None)) -> Array:
        """Density of session k for each factor and level, times its unit; one for no session."""
        std = np.atleast_1d(self.std[tracks, k])[:, None, None] * FACTORS[None, :, None]
        density = self._density(np.atleast_1d(self.z[tracks, k])[:, None, None], std, freedom)
        return np.where(np.isfinite(std), density, 1.0)

    def _density(self, z: Array, std: Array, freedom: int) -> Array:
        """Student's, of z around each level."""
        off = (z - self.level) / std
        share = 1.0 / (1.0 + off * off / freedom)
        return np.asarray(_height(freedom) * _power(share, freedom // 2) * np.sqrt(share) / std)

    def _advance(self, state: "_State", k: int, freedom: int, track: int | None = None) -> Array:
        """One session more; returns the ratio of a jump right before it, `(tracks, factors)`."""
        tracks = slice(None) if track is None else slice(track, track + 1)
        spread = self.spread[tracks, k]
        quiet, jumped = (_wandered(part, self.level, spread) for part in (state.quiet, state.jumped))
        likelihood = self._likelihood(k, freedom, tracks)
        fresh = (quiet @ self.jump) * likelihood if k > 0 else np.zeros_like(quiet)
        quiet = quiet * likelihood
        with np.errstate(divide="ignore"):
            jumped = jumped * likelihood + fresh * np.exp(-np.maximum(state.lift, -LARGEST))[:, :, None]
            size, part = quiet.sum(axis=2) + 1e-300, jumped.sum(axis=2)
            lift = np.where(np.isfinite(state.lift), state.lift, -LARGEST)
            state.lift = np.log(part) + lift - np.log(size)
        state.quiet = quiet / size[:, :, None]
        state.jumped = jumped / np.where(part > 0.0, part, 1.0)[:, :, None]
        state.log = state.log + np.log(size)
        return np.asarray(fresh.sum(axis=2) / size)

    def _place(self, track: int, start: int, end: int, freedom: int, prior: Array) -> int:
        """The most probable session of a jump that sessions up to `end` show."""
        state = _State(prior[None, :], len(self.level))
        before = []
        for k in range(start, end + 1):
            before.append((_wandered(state.quiet, self.level, self.spread[track : track + 1, k]), state.log))
            self._advance(state, k, freedom, track)
        ahead = np.ones_like(state.quiet)
        ahead_log = np.zeros((1, len(FACTORS)))
        best, place = -math.inf, end
        for k in range(end, start, -1):
            ahead = self._likelihood(k, freedom, track) * ahead
            quiet, log = before[k - start]
            inside = ((quiet @ self.jump) * ahead).sum(axis=2)
            with np.errstate(divide="ignore"):
                total = float(np.logaddexp.reduce(np.log(inside) + log + ahead_log, axis=1)[0])
            if k <= end + 1 - FEWEST_AFTER and total > best:
                best, place = total, k
            ahead = _wandered(ahead, self.level, self.spread[track : track + 1, k], backward=True)
            size = ahead.max(axis=2, keepdims=True) + 1e-300
            ahead, ahead_log = ahead / size, ahead_log + np.log(size[:, :, 0])
        return place

    def _restart(self, state: "_State", track: int, place: int, end: int, freedom: int) -> None:
        """Forgets the level of before the jump, not the scatter."""
        post = np.exp(state.log[track] - state.log[track].max()) * state.quiet[track].sum(axis=1)
        state.prior[track] = post / post.sum()
        own = _State(state.prior[track][None, :], len(self.level))
        for k in range(place, end + 1):
            self._advance(own, k, freedom, track)
        state.quiet[track], state.jumped[track], state.log[track] = own.quiet[0], 0.0, own.log[0]
        state.lift[track] = -math.inf


class _State:
    """Probabilities by track, factor and level, each sum divided by its size: `log` is the logarithm of that of
    `quiet`, and `lift` of the ratio of `jumped` to it."""

    def __init__(self, prior: Array, levels: int) -> None:
        self.quiet = np.full((*prior.shape, levels), 1.0 / levels)
        self.jumped = np.zeros_like(self.quiet)
        self.prior = prior.copy()
        self.log = np.log(prior)
        self.lift = np.full(prior.shape, -np.inf)


def _height(freedom: int) -> float:
    return math.exp(math.lgamma(0.5 * (freedom + 1.0)) - math.lgamma(0.5 * freedom)) / math.sqrt(freedom * math.pi)


def _power(x: Array, exponent: int) -> Array:
    """By squares, which takes a tenth of the time of a power."""
    power = np.ones_like(x)
    while exponent:
        if exponent & 1:
            power = power * x
        x = x * x
        exponent >>= 1
    return power


def _levels() -> Array:
    near = STEP * np.arange(1, round(FINE / STEP) + 1)
    far = FINE * (FARTHEST / FINE) ** (np.arange(1, COARSE + 1) / COARSE)
    positive = np.concatenate([near, far])
    return np.concatenate([-positive[::-1], [0.0], positive])


def _jump_probabilities(level: Array) -> Array:
    """Of a jump from each level to each other."""
    width = np.gradient(level)
    jump = width / (1.0 + ((level[None, :] - level[:, None]) / JUMP) ** 2)
    return np.asarray(jump / jump.sum(axis=1, keepdims=True))


def _wandered(probability: Array, level: Array, spread: Array, *, backward: bool = False) -> Array:
    """After steps of a variance of `spread`, one per track: to the neighbours, as often as that takes, or at once from
    any level to any other where that is too often.

    - `backward`: the probability of what comes later, given the level, before those steps
    """
    far = spread > MOST_STEPS * 0.5 * STEP**2
    steps = np.where(far, 0, np.ceil(spread / (0.5 * STEP**2))).astype(int)
    share = np.minimum(spread / np.maximum(steps, 1) / (2.0 * STEP**2), 1.0 / 3.0)[:, None, None]
    for step in range(int(steps.max(initial=0))):
        going_on = steps > step
        if going_on.all():
            probability = _stepped(probability, share)
        else:
            probability = probability.copy()
            probability[going_on] = _stepped(probability[going_on], share[going_on])
    if far.any():
        probability = probability.copy()
        apart = (level[None, :] - level[:, None]) ** 2
        moved = np.exp(-0.5 * apart[None] / spread[far, None, None]) * np.gradient(level)
        moved /= moved.sum(axis=2, keepdims=True)
        probability[far] = probability[far] @ (moved.transpose(0, 2, 1) if backward else moved)
    return probability


def _stepped(probability: Array, share: Array) -> Array:
    """A share of each level's probability to either neighbour; what would leave at the ends stays."""
    moved = share * probability
    stepped = probability - 2.0 * moved
    stepped[..., 1:] += moved[..., :-1]
    stepped[..., :-1] += moved[..., 1:]
    stepped[..., 0] += moved[..., 0]
    stepped[..., -1] += moved[..., -1]
    return np.asarray(stepped)
