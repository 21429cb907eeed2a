"""``mavsentry reproduce``: the papers' tables and figures, rebuilt by our estimators.

==========  =======================================================================
study       what a reproduction is made of: jobs, tables, figures, claims, chapters
papers      the five papers; each is a package of its own beside this file
engine      does the jobs over processes; ``store`` keeps their results on disk
drawing     figures; ``render`` writes the report, the tables as CSV and JSON
command     what is typed
==========  =======================================================================
"""

from __future__ import annotations
