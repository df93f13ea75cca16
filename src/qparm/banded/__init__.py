"""Band matrices and the quadratic programmes that smoothing and fitting share; cost linear in the unknowns."""

from typing import TYPE_CHECKING

from qparm.lazy_names import on_demand

if TYPE_CHECKING:
    from qparm.banded.matrix import band_cholesky, band_solve
    from qparm.banded.qp import banded_qp_kernel

__all__ = ["band_cholesky", "band_solve", "banded_qp_kernel"]

__getattr__, __dir__ = on_demand(
    __name__,
    {
        "band_cholesky": "matrix",
        "band_solve": "matrix",
        "banded_qp_kernel": "qp",
    },
    __all__,
)
