"""Archives of logs on many processes: one task a log, one row of a dataset for each, one page.

::

    with open_engine() as engine:
        judged = judge_all(engine, expand(["flights/**/*.tlog"]), plan)
"""
