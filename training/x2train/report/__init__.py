"""The evaluation report: an alarm's figures, not a classifier's.

`PassageTable` holds what a model said of each passage; `write` makes report.json and
report.html of it, `x2train.judge.card` what a bundle's sidecar says. The way down: table →
verdicts, windows, reliability → groups → figures → document → page.
"""

from x2train.report.table import JudgedPassage, Label, PassageTable
from x2train.report.writing import write

__all__ = ["JudgedPassage", "Label", "PassageTable", "write"]
