"""Exit codes of the commands.

0    done, nothing failed
1    an error inside qparm
2    the command, the cell or an option is not valid
3    done, with failures: whatever speaks against the trajectory (the report says what); a file that does not verify
4    the output folder, or standard output, cannot be written to
5    a solver or package that was asked for is not installed
130  interrupted; 143 terminated (:mod:`qparm.stopping`). Nothing half written is left behind.
"""

__all__ = ["DONE", "DONE_WITH_FAILURES", "FAILED", "INTERRUPTED", "INVALID", "NOT_INSTALLED", "NOT_WRITABLE"]

DONE, FAILED, INVALID, DONE_WITH_FAILURES, NOT_WRITABLE, NOT_INSTALLED, INTERRUPTED = 0, 1, 2, 3, 4, 5, 130
