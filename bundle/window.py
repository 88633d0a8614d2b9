"""The window of the bundle: the studio, STOP, the service at log-in, and the log.

It shows the service that runs, or starts one of its own, which ends with it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import tkinter as tk
import webbrowser
from collections.abc import Callable, Sequence
from pathlib import Path
from tkinter import messagebox
from urllib.error import URLError
from urllib.request import ProxyHandler, Request, build_opener

from haptix.base.errors import HaptixError
from haptix.base.task import Context
from haptix.base.version import __version__
from haptix.tasks.login import (
    InstallService,
    RemoveService,
    log_file,
    login,
    running_service,
    service_command,
)
from haptix.tasks.surfaces import ListCache

_LOOKS_MS = 500
_ENDS_S = 10.0
_DIRECT = build_opener(ProxyHandler({}))  # no proxy knows this machine
_RED, _WHITE = "#c62828", "#ffffff"


class Window:
    """The window, with a service of its own where none runs.

    Parameters
    ----------
    options : sequence of str
        Options of `haptix serve` for the service of its own.
    """

    def __init__(self, options: Sequence[str] = ()) -> None:
        self._options = options
        self.root = tk.Tk(className="haptix")
        self.root.title(f"haptix {__version__}")
        icon = Path(__file__).with_name("haptix.png")
        self.root.iconphoto(True, tk.PhotoImage(master=self.root, file=str(icon)))
        self.root.protocol("WM_DELETE_WINDOW", self.close)
        self.root.bind("<F8>", lambda _: self.stop())
        self._own: subprocess.Popen[bytes] | None = None
        self._found: tuple[int, str] | None = None
        self._looking = False
        self.state = tk.StringVar(self.root, "the service starts ...")
        self.at_login = tk.BooleanVar(self.root, login().path.exists())
        tk.Label(self.root, textvariable=self.state, width=44, anchor="w").pack(padx=12, pady=8)
        self.stop_button = tk.Button(
            self.root, text="STOP (F8)", command=self.stop, bg=_RED, fg=_WHITE, height=3,
            activebackground=_RED, activeforeground=_WHITE, font=("TkDefaultFont", 16, "bold"),
        )  # fmt: skip
        self.stop_button.pack(fill="x", padx=12, pady=4)
        self.studio_button = self._button("Open the studio", self.open_studio)
        self.login_button = tk.Checkbutton(
            self.root, text="Start when I log in", variable=self.at_login, command=self.turn_login
        )
        self.login_button.pack(anchor="w", padx=12)
        self._button("Log", lambda: webbrowser.open(log_file().as_uri()))
        self._button("Quit", self.close)
        self._button("Uninstall ...", self.uninstall)
        self._look()

    def _button(self, text: str, command: Callable[[], object]) -> tk.Button:
        button = tk.Button(self.root, text=text, command=command)
        button.pack(fill="x", padx=12, pady=4)
        return button

    def _look(self) -> None:
        """Look for the service, in a thread of its own: STOP must not wait for an answer."""
        if not self._looking:
            self._looking = True
            threading.Thread(target=self._find, daemon=True).start()
        self.root.after(_LOOKS_MS, self._look)
        if self._found is not None:
            self.state.set(f"the service runs: http://127.0.0.1:{self._found[0]}")
        elif self._own is not None and self._own.poll() is not None:
            self.state.set("the service has ended, see the log")

    def _find(self) -> None:
        self._found = running_service()
        if self._found is None and self._own is None and not login().path.exists():
            self.start()
        self._looking = False

    def start(self) -> None:
        """Start a service of this window's own."""
        log_file().parent.mkdir(parents=True, exist_ok=True)
        quiet = getattr(subprocess, "CREATE_NO_WINDOW", 0)
        command = service_command(log_file(), self._options)
        nothing = subprocess.DEVNULL
        self._own = subprocess.Popen(
            command, stdin=nothing, stdout=nothing, stderr=nothing, creationflags=quiet
        )

    def stop(self) -> None:
        """End at 0 V, for all apps; if no service answers, end that of this window."""
        threading.Thread(target=self._stop, daemon=True).start()

    def _stop(self) -> None:
        try:
            if self._found is None:
                raise URLError("no service")
            stop = Request(f"http://127.0.0.1:{self._found[0]}/stop", b"", method="POST")
            _DIRECT.open(stop, timeout=1.0).close()
        except OSError:
            if self._own is not None:
                self._own.kill()  # the driver's watchdog then ends the output

    def open_studio(self) -> None:
        """Open the studio's page, with a code that lets it in."""
        if self._found is not None:
            webbrowser.open("http://127.0.0.1:{}/#code={}".format(*self._found))

    def turn_login(self) -> None:
        """Install or remove the service at log-in."""
        try:
            if self.at_login.get():
                self.end_own()  # its port is free for the other
                InstallService().run(Context())
            else:
                RemoveService().run(Context())
        except HaptixError as error:
            messagebox.showerror("haptix", str(error))
        self.at_login.set(login().path.exists())

    def uninstall(self) -> None:
        """Remove all that haptix wrote but what a person made; the folder is for the person."""
        if not messagebox.askokcancel(
            "haptix",
            "Remove the service at log-in, logs, tokens and surfaces that were solved? Layouts, "
            "profiles and results stay.",
        ):
            return
        self.end_own()
        RemoveService().run(Context())
        ListCache(clear=True).run(Context())
        messagebox.showinfo("haptix", "Done. Now delete the folder of this program.")
        self.close()

    def end_own(self) -> None:
        """End the service of this window."""
        if self._own is not None:
            self._own.terminate()
            try:
                self._own.wait(_ENDS_S)
            except subprocess.TimeoutExpired:
                self._own.kill()
        self._own = None

    def close(self) -> None:
        """End."""
        self.end_own()
        self.root.destroy()


def main() -> None:
    """Show the window until it is closed."""
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        sys.exit("haptix: no screen for a window; `haptix --help` lists the commands")
    Window().root.mainloop()
