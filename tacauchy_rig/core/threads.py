"""One thread for NumPy and SciPy: their matrices are small, and threads that wait burn time."""

import os

# Read by OpenBLAS when it is loaded, the first of them that is set; NumPy and SciPy bring it.
_READ_BY_OPENBLAS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")
# Read by sim/solve/linear_solver.py, which else chooses by the number of unknowns.
_READ_BY_MKL = ("MKL_NUM_THREADS", "OMP_NUM_THREADS")


def take_one_thread(*, solver_too: bool = False) -> None:
    """Let this process and all that it starts compute with one thread each; what a user set stays.

    To be called before NumPy is imported.

    Args:
        solver_too: Also factor matrices of any size with one: for a process that has siblings.
    """
    for names in (_READ_BY_OPENBLAS, *((_READ_BY_MKL,) if solver_too else ())):
        if not any(name in os.environ for name in names):
            os.environ[names[0]] = "1"
