"""What stands between files from strangers and the machine.

* :mod:`~physretarget.sandbox.limits`: every bound in one place;
* :mod:`~physretarget.sandbox.archive`: unpacking zip files;
* :mod:`~physretarget.sandbox.mjcf`: models, looked at before MuJoCo sees them;
* :mod:`~physretarget.sandbox.child`: running a task in a process that can reach nothing else.

The threats, and what is not defended, are in docs/service.md.
"""
