"""Bodies of LLVM functions with loops: what the kernels of this package have and straight-line code has not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from echelon.machine.text import Code

_DOUBLE = 8


@dataclass
class Routine(Code):
    """A function body that knows the block it is in, so that loops and branches can be nested."""

    block: str = "entry"

    def label(self, name: str) -> None:
        """Begin a block."""
        super().label(name)
        self.block = name

    def at(self, pointer: str, offset: int | str) -> str:
        """The address some doubles after a pointer."""
        return self.let(f"getelementptr double, ptr {pointer}, i64 {offset}")

    def load(self, kind: str, pointer: str) -> str:
        """A value in memory, of which only the alignment of doubles is known."""
        return self.let(f"load {kind}, ptr {pointer}, align {_DOUBLE}")

    def store(self, kind: str, value: str, pointer: str) -> None:
        """Write a value, assuming only the alignment of doubles."""
        self.do(f"store {kind} {value}, ptr {pointer}, align {_DOUBLE}")

    def entry(self, kind: str, table: str, index: int | str) -> str:
        """An entry of a table of pointers or integers."""
        return self.let(f"load {kind}, ptr {self.let(f'getelementptr {kind}, ptr {table}, i64 {index}')}")

    def add_product(self, kind: str, a: str, b: str, total: str) -> str:
        """total + a·b, fused where the processor can."""
        product = self.let(f"fmul contract {kind} {a}, {b}")
        return self.let(f"fadd contract {kind} {total}, {product}")

    def loop(
        self,
        bounds: tuple[int | str, int | str, int],
        carried: Sequence[tuple[str, str]],
        body: Callable[[str, list[str]], Sequence[str]],
    ) -> list[str]:
        """A loop that runs at least once.

        Parameters
        ----------
        bounds : (start, stop, step)
            Of the index, an i64; start < stop.
        carried : sequence of (type, initial value)
            What one turn hands to the next.
        body : callable
            Given the index and the carried values, writes a turn and returns their new values.

        Returns
        -------
        list of str
            The carried values after the last turn.
        """
        start, stop, step = bounds
        before, head = self.block, self.fresh("loop")
        self.do(f"br label %{head}")
        self.label(head)
        index = f"%{head}.index"
        names = [f"%{head}.{i}" for i in range(len(carried))]
        place = len(self.lines)
        new = list(body(index, names))
        following = self.let(f"add nuw nsw i64 {index}, {step}")
        more = self.let(f"icmp slt i64 {following}, {stop}")
        latch, after = self.block, self.fresh("done")
        self.do(f"br i1 {more}, label %{head}, label %{after}")
        values = [("i64", index, start, following)]
        values += [(kind, name, first, last) for (kind, first), name, last in zip(carried, names, new, strict=True)]
        self.lines[place:place] = [
            f"  {name} = phi {kind} [ {first}, %{before} ], [ {last}, %{latch} ]" for kind, name, first, last in values
        ]
        self.label(after)
        return new

    def when(self, condition: str, body: Callable[[], None]) -> None:
        """Run a body if an i1 is true."""
        inside, after = self.fresh("then"), self.fresh("end")
        self.do(f"br i1 {condition}, label %{inside}, label %{after}")
        self.label(inside)
        body()
        self.do(f"br label %{after}")
        self.label(after)

    def while_below(self, bounds: tuple[int | str, int | str, int], body: Callable[[str], None]) -> None:
        """A loop that carries nothing and may not run at all."""
        start, stop, _ = bounds

        def turn(index: str, _: list[str]) -> list[str]:
            body(index)
            return []

        def run() -> None:
            self.loop(bounds, [], turn)

        self.when(self.let(f"icmp slt i64 {start}, {stop}"), run)

    def fresh(self, stem: str) -> str:
        """A label that is not in use."""
        self._count += 1
        return f"{stem}{self._count}"

    def function(self, head: str) -> str:
        """The whole function, without a result."""
        return f"{head} {{\nentry:\n{self.text()}\n  ret void\n}}\n"
