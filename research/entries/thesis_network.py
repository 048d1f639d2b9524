"""The thesis' network: two hidden layers of 100 and 50 on its cadence-velocity vector.

Source: the master's thesis that this project starts from, sections 3 and 4; how its training
is reproduced is told in `x2train.thesis.fit` and docs/thesis-results.md.
"""

import numpy as np
from numpy.typing import NDArray

from benchmark_tasks import Elements
from x2train.thesis.fit import fit, fit_settings
from x2train.thesis.sets import CellData

TITLE = "thesis' network"
_STOP_SHARE = 20
"""One in so many training elements says when to stop, as in docs/thesis-results.md."""


def scores(train: Elements, test: Elements, seed: int) -> NDArray[np.float64]:
    """Return the probability of a person for every element of `test`."""
    settings = fit_settings(
        "relu",
        seed=seed,
        repeats=1,
        pretrain_epochs=(12, 3),
        output_epochs=9,
        epochs=200,
    )
    data = CellData(train.vector, train.is_person.astype(np.int64), train.in_view)
    n_stop = max(2, len(train) // _STOP_SHARE // 2 * 2)
    fitted = fit(data.part(n_stop, len(train)), data.part(0, n_stop), settings)
    return fitted.predict(test.vector)[0, :, 1]
