"""How a network of the thesis is trained: every knob, checked when it is turned."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from radard.errors import UsageError
from x2train.thesis.mlp import ACTIVATIONS

SCALINGS = ("none", "block", "each")
OPTIMISERS = ("adam", "momentum", "lbfgs")
ERRORS = ("cross-entropy", "mse")


@dataclass(frozen=True, slots=True, kw_only=True)
class FitSettings:
    """How to train."""

    layers: tuple[int, ...] = (100, 50)
    activation: str = "relu"  # 'relu', 'sigmoid' or 'tanh'
    n_outputs: int = 2  # 2 (softmax), or 1 (logistic)
    error: str = "cross-entropy"  # 'cross-entropy', 'mse': what training makes small
    # 'adam', 'momentum', 'lbfgs': batches of `batch`, but for L-BFGS, which takes the whole set
    optimiser: str = "adam"
    learning_rate: float = 0.001  # of the optimiser; L-BFGS searches along its line and takes none
    # share of the last step in the next one (3.5); with Adam, of its mean gradient
    momentum: float = 0.9
    batch: int = 100
    # a step takes this times the learning rate off every weight: an L2 penalty, with Adam in its
    # decoupled form (Loshchilov and Hutter 2019, recalled). L-BFGS gets the penalty itself. It
    # holds in every stage: autoencoders without it learn to blow up the weakest inputs.
    decay: float = 0.7
    # networks are judged by the running mean of their weights, this share of it kept at every
    # step (Polyak and Juditsky 1992, recalled); 0 for the weights themselves
    averaging: float = 0.999
    # penalty on the autoencoders' codes: L1 for ReLU, else the Kullback-Leibler divergence of
    # their mean from 0.05
    sparsity: float = 0.0
    pretrain_epochs: tuple[int, ...] = (500, 100)  # of each autoencoder; () for none
    output_epochs: int = 400  # of the output layer alone
    # of the whole network, and how often it is looked at
    epochs: int = 2000
    look_every: int = 100
    patience: int = 2  # looks without a gain in any repeat that end a training
    repeats: int = 10  # initial weights tried
    seed: int = 0  # of weights and order
    # 'none', 'block', 'each': inputs as they are; the range profile and the type 1 part each by
    # one factor to a mean square of 1; or every input to mean 0 and deviation 1
    scaling: str = "none"

    def __post_init__(self) -> None:
        """Validate the settings; the error names every wrong one."""
        n_pretrain = len(self.pretrain_epochs)
        rules = (
            ("layers", bool(self.layers) and min(self.layers) > 0, "at least one, above 0"),
            ("activation", self.activation in ACTIVATIONS, f"one of {', '.join(ACTIVATIONS)}"),
            ("n_outputs", self.n_outputs in {1, 2}, "1 or 2"),
            ("error", self.error in ERRORS, f"one of {', '.join(ERRORS)}"),
            ("optimiser", self.optimiser in OPTIMISERS, f"one of {', '.join(OPTIMISERS)}"),
            ("learning_rate", 0 < self.learning_rate <= 10, "above 0, at most 10"),
            ("scaling", self.scaling in SCALINGS, f"one of {', '.join(SCALINGS)}"),
            ("momentum", 0 <= self.momentum < 1, "0 to below 1"),
            ("batch", self.batch > 0, "1 or more"),
            ("decay", self.decay >= 0, "0 or more"),
            ("averaging", 0 <= self.averaging < 1, "0 to below 1"),
            ("sparsity", self.sparsity >= 0, "0 or more"),
            ("pretrain_epochs", min(self.pretrain_epochs, default=0) >= 0, "none below 0"),
            ("pretrain_epochs", n_pretrain in {0, len(self.layers)}, "none, or one a layer"),
            ("output_epochs", self.output_epochs >= 0, "0 or more"),
            ("epochs", self.epochs >= self.look_every > 0, "at least look_every, above 0"),
            ("patience", self.patience > 0, "1 or more"),
            ("repeats", self.repeats > 0, "1 or more"),
            ("seed", self.seed >= 0, "0 or more"),
        )
        faults = [
            f"{name} = {getattr(self, name)!r}: {rule}" for name, good, rule in rules if not good
        ]
        if faults:
            raise UsageError("; ".join(faults))


_LESS: Mapping[str, Mapping[str, Any]] = {
    "sigmoid": {"scaling": "block", "decay": 0.1},
    "tanh": {"scaling": "block", "decay": 0.1},
}
"""Where inputs of unit norm would leave every unit in the middle of its curve."""


def fit_settings(activation: str, **changes: Any) -> FitSettings:
    """Return the settings that suit an activation, with changes; raises as `FitSettings`."""
    return FitSettings(**{"activation": activation, **_LESS.get(activation, {}), **changes})
