"""The blocks of Gamma (`loss.py`) that the error of a sample needs."""

from __future__ import annotations

from torch import Tensor

# Bytes of the blocks that are kept for a set of samples.
_KEPT = 2_000_000_000


class SampleBlocks:
    """Gamma among the loads of each of s samples, (m dim, m dim) in the order of loads and axes. Training asks
    for the same blocks hundreds of times, and gathering one from Gamma costs ten times what a product with it does: so
    blocks are kept, as far as they take little memory. loads: (s, n) of each sample, the first `count` (s,) of
    them."""

    def __init__(self, gamma: Tensor, loads: Tensor, count: Tensor) -> None:
        self._gamma, self._loads, self._count = gamma, loads, count
        self._left, self._kept = _KEPT, dict[int, Tensor]()

    def _gathered(self, k: int) -> Tensor:
        loads = self._loads[k, : int(self._count[k])]
        size = len(loads) * self._gamma.shape[-1]
        return self._gamma[loads[:, None], loads].permute(0, 2, 1, 3).reshape(size, size).contiguous()

    def __getitem__(self, k: int) -> Tensor:
        if k in self._kept:
            return self._kept[k]
        block = self._gathered(k)
        self._left -= block.numel() * block.element_size()
        if self._left >= 0:
            self._kept[k] = block
        return block
