"""Scenes to train on: procedural scenes and users' own, rendered with Mitsuba 3.

Commands: ``python -m training.scenes.render``, ``python -m training.scenes.render_scene``,
``python -m training.scenes.sheet``. See docs/scenes.md.
"""
