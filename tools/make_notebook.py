"""Run the example notebook and write what its cells show into it: ``python tools/make_notebook.py [OUT]``."""

from __future__ import annotations

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).parents[1] / "examples" / "explore.ipynb"
METADATA = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
"""Of the kernel; what else Jupyter notes there differs between machines."""


def main(out: Path = NOTEBOOK) -> None:
    """Write the notebook with its outputs, the same from the same code."""
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    # A cell takes some seconds at most; the first one that raises ends this, as it would end a test.
    NotebookClient(notebook, timeout=60, kernel_name="python3", record_timing=False, coalesce_streams=True).execute()
    notebook.metadata = nbformat.from_dict(METADATA)
    for number, cell in enumerate(notebook.cells):
        cell.id, cell.metadata = f"cell{number:02d}", nbformat.from_dict({})
    nbformat.write(notebook, out)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
