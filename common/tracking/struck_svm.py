"""Online structured-output support vector machine with a budget (Hare et al. 2011, DOI 10.1109/ICCV.2011.6126251).

LaRank (Bordes et al. 2007): each picture is a pattern, a set of boxes with features, of which the first is the target.
The machine holds F(target) above F(another box) by a margin of their loss, 1 - overlap.
"""

from __future__ import annotations

import numpy as np

from common.tracking.struck_svm_compiled import ZERO, optimise, step


class StructuredSvm:
    """Discriminant F(x) = Σ β_i k(x_i, x) over support vectors, with the kernel exp(-γ |x - x'|²).

    Args:
        size: D, numbers of a feature vector; all have length one.
        budget: most support vectors.
        cost: C.
        gamma: γ.
        rng: chooses old patterns.
    """

    def __init__(self, size: int, budget: int, cost: float, gamma: float, rng: np.random.Generator):
        self._budget, self._cost, self._gamma, self._rng = budget, cost, gamma, rng
        room = budget + 3
        self._vectors = np.zeros((room, size), np.float32)
        self._kernel = np.zeros((room, room))
        self._beta, self._gradient = np.zeros(room), np.zeros(room)
        self._pattern, self._choice = np.full(room, -1), np.zeros(room, int)
        self._count = 0
        self._patterns: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        self._next = 0

    @property
    def support_vectors(self) -> int:
        """How many there are."""
        return self._count

    def evaluate(self, features: np.ndarray) -> np.ndarray:
        """F (n,) of feature vectors (n, D) of unit length."""
        n = self._count
        return self._kernel_of(features, self._vectors[:n]) @ self._beta[:n]

    def learn(self, features: np.ndarray, losses: np.ndarray, reprocessed: int, optimised: int) -> None:
        """Take in a pattern and improve the dual.

        Args:
            features: (m, D) of its boxes, the first one the target.
            losses: (m,) of them against the target, 0 to 1; the first one 0.
            reprocessed: steps over old patterns afterwards.
            optimised: steps over known support vectors after each of these.
        """
        number = self._next
        self._next += 1
        self._patterns[number] = (features, losses)
        scores = self.evaluate(features)
        positive = self._add(number, 0, -float(scores[0]))
        gradient = -losses - scores
        worst = int(gradient.argmin())
        if worst != 0:
            self._step(positive, self._add(number, worst, float(gradient[worst])))
        self._tidy()
        for _ in range(reprocessed):
            self._process_old()
            self._optimise(optimised)
            self._tidy()

    def _kernel_of(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return np.exp(2.0 * self._gamma * (one @ other.T - 1.0))

    def _add(self, pattern: int, choice: int, gradient: float) -> int:
        n = self._count
        vector = self._patterns[pattern][0][choice]
        self._vectors[n] = vector
        row = self._kernel_of(vector[None], self._vectors[: n + 1])[0]
        self._kernel[n, : n + 1], self._kernel[: n + 1, n] = row, row
        self._beta[n], self._gradient[n] = 0.0, gradient
        self._pattern[n], self._choice[n] = pattern, choice
        self._count += 1
        return n

    def _remove(self, index: int) -> None:
        """Put the last support vector in the place of this one."""
        last = self._count - 1
        pattern = self._pattern[index]
        for array in (self._vectors, self._beta, self._gradient, self._pattern, self._choice, self._kernel):
            array[index] = array[last]
        self._kernel[:, index] = self._kernel[:, last]
        self._count = last
        if not (self._pattern[:last] == pattern).any():
            del self._patterns[int(pattern)]

    def _random_pattern(self) -> tuple[int, np.ndarray]:
        """One that has support vectors, and their indices (k,)."""
        number = self._pattern[self._rng.integers(self._count)]
        return int(number), np.flatnonzero(self._pattern[: self._count] == number)

    def _best_positive(self, own: np.ndarray) -> int | None:
        room = self._beta[own] < self._cost * (self._choice[own] == 0) - ZERO
        if not room.any():
            return None
        candidates = own[room]
        return int(candidates[self._gradient[candidates].argmax()])

    def _process_old(self) -> None:
        number, own = self._random_pattern()
        positive = self._best_positive(own)
        if positive is None or self._count >= len(self._beta) - 1:
            return
        features, losses = self._patterns[number]
        gradient = -losses - self.evaluate(features)
        worst = int(gradient.argmin())
        known = own[self._choice[own] == worst]
        negative = int(known[0]) if len(known) else self._add(number, worst, float(gradient[worst]))
        self._step(positive, negative)

    def _optimise(self, steps: int) -> None:
        picks = self._rng.integers(self._count, size=steps)
        optimise(
            picks, self._count, self._cost, self._pattern, self._choice, self._beta, self._gradient, self._kernel
        )  # fmt: skip

    def _step(self, positive: int, negative: int) -> None:
        """One step of sequential minimal optimisation on two coefficients of a pattern."""
        step(
            positive, negative, self._count, self._cost, self._choice, self._beta, self._gradient, self._kernel
        )  # fmt: skip

    def _tidy(self) -> None:
        """Drop coefficients that are zero, then keep to the budget."""
        for index in range(self._count - 1, -1, -1):
            if abs(self._beta[index]) < ZERO:
                self._remove(index)
        while self._count > self._budget:
            self._drop_least()

    def _drop_least(self) -> None:
        """Merge the negative support vector that changes F least into the positive one of its pattern."""
        n = self._count
        negatives = np.flatnonzero(self._beta[:n] < 0)
        positive_of = {int(self._pattern[i]): i for i in range(n) if self._choice[i] == 0 and self._beta[i] > 0}
        partners = np.array([positive_of[int(p)] for p in self._pattern[negatives]])
        change = self._beta[negatives] ** 2 * (2.0 - 2.0 * self._kernel[negatives, partners])
        least = int(change.argmin())
        negative, positive = int(negatives[least]), int(partners[least])
        move = float(self._beta[negative])
        self._beta[positive] += move
        self._gradient[:n] -= move * (self._kernel[:n, positive] - self._kernel[:n, negative])
        self._beta[negative] = 0.0
        for index in sorted((negative, positive), reverse=True):
            if abs(self._beta[index]) < ZERO:
                self._remove(index)
