"""The program of the bundle: the window, a command, or one of the service's own processes.

haptix starts its processes as ``sys.executable -m module`` and ``-P -c program``; in a bundle that
is this program.
"""

import multiprocessing
import runpy
import sys

if __name__ == "__main__":
    multiprocessing.freeze_support()
    match [one for one in sys.argv[1:] if one != "-P"]:
        case []:
            from window import main as show

            show()
        case ["-m", module, *rest]:
            sys.argv = [module, *rest]
            runpy.run_module(module, run_name="__main__", alter_sys=True)
        case ["-c", program, *rest]:
            sys.argv = ["-c", *rest]
            exec(compile(program, "<command>", "exec"))
        case _:
            from haptix.tasks.cli import main

            main()
