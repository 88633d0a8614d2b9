"""A window in which the mouse is the finger: press the left button and slide.

    python examples/mouse_finger.py [--device mock:pace=real] [--photograph wall.png]

Above: a photograph, a grating, a slider with detents and a button, on one layout. The right mouse
button drags the photograph while it is felt. The wheel presses harder or softer: the button gives
way at 0.8 N. Below: the friction asked for, the voltage, and where the finger is, as they are
rendered. The screen is a mock driver in real time; any other device plays the same.
"""

import sys
from functools import partial
from pathlib import Path

import numpy as np
import typer

import haptix
from haptix.feel import Button, Grating, LayoutEvent, LayoutRegion, ScreenGeometry, Slider
from haptix.play import LiveSettings, TouchEvent
from haptix.play.render.played import COLUMNS, PlayedRecord

try:
    from skimage import data
except ModuleNotFoundError as error:
    sys.exit(f"needs {error.name}; run: pip install 'haptix-electrovibration[figures]'")

try:
    import tkinter as tk
except ModuleNotFoundError:  # a package of its own in some systems
    sys.exit("mouse_finger: needs Python's tkinter; on Debian: apt install python3-tk")

WIDTH_MM, HEIGHT_MM, PIXELS_PER_MM, SHOWN_S, FRAME_MS = 120.0, 70.0, 7.0, 3.0, 33
SETTLED_S = 0.02  # before now: what is played later may still be rendered again
WANTED = COLUMNS.index("wanted")
LINES = (("friction", "#2266bb", 0.25, 0.4), ("voltage (V)", "#7733aa", 0.0, 210.0))


class Session:
    """All but the drawing: a layout, its renderer, and what it has rendered lately."""

    def __init__(self, device: str, photograph: Path | None = None) -> None:
        model = haptix.ContactModel(
            haptix.Finger.preset("semi-wet"), haptix.Screen.preset("3m-sct3250")
        )
        ranges = {"normal_force_n": (0.1, 2.0), "frequency_hz": 4000}
        surface = haptix.FrictionSurface.build(model, ranges)
        image = data.brick() if photograph is None else photograph
        self.screen = ScreenGeometry(
            WIDTH_MM * PIXELS_PER_MM, HEIGHT_MM * PIXELS_PER_MM, WIDTH_MM, HEIGHT_MM
        )
        self.layout = haptix.Layout()
        wall = haptix.Texture.from_image(image, width_mm=50)
        self.photograph = self.layout.add(wall, 5, 5, 50, min(wall.height_mm, 40))
        self.layout.add(Grating(period_mm=3.0, wave="square"), 65, 5, 50, 25)
        self.layout.add(Slider(travel_mm=80, detents=9), 20, 50, 80, 14)
        self.layout.add(Button(), 80, 35, 16, 12)
        settings = LiveSettings(strict=False)
        self.renderer = haptix.LiveRenderer(
            surface, self.layout, haptix.open_device(device), settings=settings
        )
        self.record = self.renderer.record = PlayedRecord(self.renderer)
        self.rows = np.zeros((3, 0))
        self.force_n = 0.5
        self.said = "press the left button and slide"
        for kind in ("enter", "leave", "press", "release", "detent"):
            self.renderer.on(kind, self.heard)

    def heard(self, event: LayoutEvent) -> None:
        what = "" if event.region is None else type(event.region.material).__name__
        number = f" {event.detent:g}" if event.kind == "detent" else ""
        self.said = f"{event.kind} {what}{number}"

    def finger(self, x_px: float, y_px: float) -> None:
        self.renderer.touch(self.renderer.now_s(), *self.screen.mm(x_px, y_px), self.force_n)

    def lift(self) -> None:
        self.renderer.event(TouchEvent(self.renderer.now_s(), 0, 0.0, 0.0, "up"))

    def drag(self, x_px: float, y_px: float) -> None:
        x, y = self.screen.mm(x_px, y_px)
        self.photograph.move(x - 25, y - 20)

    def press(self, steps: float) -> None:
        self.force_n = float(np.clip(self.force_n + 0.1 * steps, 0.1, 2.0))

    def lately(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times before now [s], friction (NaN where no finger is) and amplitude [V]."""
        part = self.record.take(self.renderer.now_s() - SETTLED_S)
        if part is not None:
            volts = part.amplitude_v[:: round(part.row_s / part.step_s)]
            t = part.t0_s + part.row_s * np.arange(len(volts))
            finger = part.rows.get(0)
            mu = np.full(len(t), np.nan) if finger is None else finger[:, WANTED]
            self.rows = np.hstack([self.rows, [t, mu, volts]])
            self.rows = self.rows[:, self.rows[0] > t[-1] - SHOWN_S]
        t, mu, volts = self.rows
        return t - t[-1:], mu, volts


class Window(tk.Tk):
    """Draws a session, and gives it the mouse."""

    def __init__(self, session: Session) -> None:
        super().__init__()
        self.title("haptix: the mouse is the finger")
        self.session = session
        width, height = session.screen.pixels_x, session.screen.pixels_y
        self.pad = tk.Canvas(self, width=width, height=height, bg="white")
        self.plot = tk.Canvas(self, width=width, height=240, bg="#f6f6f6")
        self.words = tk.Label(self, anchor="w", font="TkFixedFont")
        for part in (self.pad, self.plot, self.words):
            part.pack(fill="x")
        bar = tk.Frame(self)
        bar.pack(fill="x")
        scale = tk.Scale(bar, from_=0, to=100, orient="horizontal", label="intensity (%)")
        scale.set(100)
        scale.configure(command=lambda share: self.turn(float(share)))
        scale.pack(side="left", fill="x", expand=True)
        for name, on in (("pause", True), ("resume", False)):
            button = tk.Button(bar, text=name, command=partial(session.renderer.pause, on))
            button.pack(side="left")
        self.pad.bind("<B1-Motion>", lambda event: session.finger(event.x, event.y))
        self.pad.bind("<Button-1>", lambda event: session.finger(event.x, event.y))
        self.pad.bind("<ButtonRelease-1>", lambda _: session.lift())
        self.pad.bind("<B3-Motion>", lambda event: session.drag(event.x, event.y))
        self.pad.bind("<MouseWheel>", lambda event: session.press(event.delta / 120))
        self.pad.bind("<Button-4>", lambda _: session.press(1))
        self.pad.bind("<Button-5>", lambda _: session.press(-1))
        self.draw()

    def turn(self, percent: float) -> None:
        self.session.renderer.intensity(percent / 100)

    def report_callback_exception(self, kind: object, error: BaseException, trace: object) -> None:
        self.destroy()
        raise error

    def draw(self) -> None:
        """Draw regions, lines and words, and do it again soon."""
        self.pad.delete("all")
        for region in self.session.layout.regions.values():
            if region.is_there:
                self.region(region)
        ages, *rows = self.session.lately()
        self.plot.delete("all")
        for i, (values, (name, colour, low, high)) in enumerate(zip(rows, LINES, strict=True)):
            self.line(ages, values, (i * 120, 120), (low, high), colour)
            self.plot.create_text(6, i * 120 + 12, text=name, anchor="w", fill=colour)
        mu, volts = (float(row[-1]) if len(row) else 0.0 for row in rows)
        x, y = self.session.screen.mm(
            self.pad.winfo_pointerx() - self.pad.winfo_rootx(),
            self.pad.winfo_pointery() - self.pad.winfo_rooty(),
        )
        self.words["text"] = (
            f"x {x:6.1f} mm  y {y:5.1f} mm  force {self.session.force_n:.1f} N  "
            f"friction {mu:.3f}  {volts:5.1f} V   {self.session.said}"
        )
        self.after(FRAME_MS, self.draw)

    def region(self, region: LayoutRegion) -> None:
        pixels = self.session.screen.pixels
        left, top = pixels(region.x_mm, region.y_mm)
        right, bottom = pixels(region.x_mm + region.width_mm, region.y_mm + region.height_mm)
        self.pad.create_rectangle(left, top, right, bottom, fill="#e4ded4")
        name = type(region.material).__name__
        self.pad.create_text((left + right) / 2, (top + bottom) / 2, text=name)

    def line(
        self,
        ages: np.ndarray,
        values: np.ndarray,
        where: tuple[float, float],
        span: tuple[float, float],
        colour: str,
    ) -> None:
        top, height = where
        width = self.session.screen.pixels_x
        x = width * (1 + ages / SHOWN_S)
        y = top + height * (0.95 - 0.8 * (values - span[0]) / (span[1] - span[0]))
        for part in np.split(np.arange(len(y)), np.flatnonzero(np.isnan(y))):
            inside = part[~np.isnan(y[part])][::2]
            if len(inside) > 1:
                points = np.stack([x[inside], y[inside]], axis=1).ravel().tolist()
                self.plot.create_line(*points, fill=colour)


def main(device: str = "mock:pace=real", photograph: Path | None = None) -> None:
    session = Session(device, photograph)
    window = Window(session)  # first: a driver that plays waits for no window to open
    with session.renderer:
        window.mainloop()
    print(session.renderer.stats)


if __name__ == "__main__":
    try:
        typer.run(main)
    except (haptix.HaptixError, OSError, tk.TclError) as error:
        sys.exit(f"mouse_finger: {error}")
