"""Running means of the losses."""

import math

import torch
import torch.distributed as distributed
from torch import Tensor

from relight.files import UserError


class Meter:
    """Means of the losses over an epoch, gathered on the device: no step waits for a number to come back."""

    def __init__(self, device: torch.device):
        self.device = device
        self.clear()

    def clear(self) -> None:
        self.names, self.sums, self.steps = [], 0.0, 0
        self.bad = torch.tensor(torch.inf, device=self.device)

    def add(self, values: dict[str, Tensor], step: int) -> None:
        row = torch.stack([value.detach() for value in values.values()])
        self.names, self.sums, self.steps = list(values), self.sums + row, self.steps + 1
        self.bad = torch.where(row[0].isfinite(), self.bad, self.bad.clamp_max(step))

    def means(self, world: int) -> dict[str, float]:
        """The means over steps and processes, and a fresh start. Raises UserError that names the first bad step."""
        if world > 1:
            distributed.all_reduce(self.sums)
            distributed.all_reduce(self.bad, op=distributed.ReduceOp.MIN)
        means, bad = (self.sums / (self.steps * world)).tolist(), self.bad.item()
        if bad < math.inf:
            raise UserError(
                f"the loss is not a finite number at step {int(bad)}: the last good state is kept; try a lower train.lr"
            )
        names = self.names
        self.clear()
        return dict(zip(names, means))
