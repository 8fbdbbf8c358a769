"""Trials of the whole product, too long for every change: run by `.ci/nightly trials`.

- `python -m tests.targets.right_models`: right models of many libraries and kinds, no false alarm.
- `python -m tests.targets.wrong_functions`: planted faults by kind and by functions given.
- `python -m tests.targets.wrong_engines`: planted faults of engines, found by `validate --engine`.
- `python -m tests.targets.hostile`: inputs that nobody means, refused in a sentence and in time.
"""
