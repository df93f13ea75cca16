"""Random cells, planned by the command and judged by a judge that imports nothing of qparm."""
