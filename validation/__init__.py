"""What holds the product against sealed truths and published tables: part of the repository, not of the wheel.

``python -m validation blind`` and ``python -m validation paper|gap``; in a checkout also ``rig blind`` and
``rig study paper|gap``.
"""
