"""The page of a run, in headless Chromium: everything is drawn, moves with the time, and stays quiet.

Usage: report_page.py PLATOON SCRATCH

Makes pages with the command PLATOON below the folder SCRATCH: of a rehearsal with its summary, of a
trace alone, of two runs over each other, and of the trace alone of a run in real time. How long
drawing takes is reported, not judged.
"""

import shutil
import subprocess
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

# The plots that every run has curves for; those of a tick's latency only come in real time.
PLOTS = [
    "predecessor_error_m", "leader_error_m", "speed_mps", "y_m", "force_command_n",
    "steering_command_rad", "adaptive_weight", "potential", "predecessor_delay_s",
    "leader_delay_s", "obstacle_clearance_m", "accel_mps2", "bus_load_percent",
]
SECTIONS = ["movement", "criteria", "signals", "trucks-table", "bus", "machine"]


class Opened:
    """A page in a browser without network, and everything it complained about."""

    def __init__(self, browser, path, fragment="", **context):
        self.path = path
        self.complaints = []
        self.context = browser.new_context(offline=True, **context)
        self.page = self.context.new_page()
        self.page.on("console", lambda message: self.complain(message.type, message.text))
        self.page.on("pageerror", lambda error: self.complain("error", str(error)))
        self.page.on("request", self.asked)
        self.page.goto(path.as_uri() + fragment)
        self.page.wait_for_selector("body[data-drawn-ms]", timeout=30_000)
        # What is out of sight is made after that, whether somebody looks at it or not.
        self.page.wait_for_selector("body[data-complete-ms]", timeout=30_000)
        self.drawn_ms = self.do("document.body.dataset.drawnMs")
        self.complete_ms = self.do("document.body.dataset.completeMs")

    def complain(self, kind, text):
        if kind in ("error", "warning"):
            self.complaints.append(f"{kind}: {text}")

    def asked(self, request):
        if not request.url.startswith(self.path.as_uri()):
            self.complaints.append(f"asked for {request.url[:100]}")

    def do(self, script, *arguments):
        return self.page.evaluate(script, *arguments)

    def time(self):
        return float(self.do("Clock.time()"))

    def close(self):
        assert not self.complaints, f"{self.path}: {self.complaints}"
        self.context.close()


def scrub(opened, time):
    """Moves the time line as a hand would."""
    opened.do(
        """time => {
            const scrub = document.getElementById("scrub");
            scrub.value = time;
            scrub.dispatchEvent(new Event("input"));
        }""",
        time,
    )


def every_plot_has_its_curves(opened, runs):
    ink = opened.do(
        """() => Object.fromEntries(Plots.all().map(({ plot, u, lines }) => {
            const { width, height } = u.ctx.canvas;
            const pixels = u.ctx.getImageData(0, 0, width, height).data;
            let coloured = 0;
            for (let i = 0; i < pixels.length; i += 4) {
                const [r, g, b] = pixels.slice(i, i + 3);
                if (pixels[i + 3] > 100 && Math.max(r, g, b) - Math.min(r, g, b) > 60) coloured++;
            }
            return [plot.name, { curves: lines.length, coloured }];
        }))"""
    )
    for name in PLOTS:
        assert name in ink, f"no plot of {name}: {list(ink)}"
        followers = 3 * runs
        assert ink[name]["curves"] >= followers, f"{name}: {ink[name]}"
        assert ink[name]["coloured"] > 100, f"{name} is empty: {ink[name]}"


def scrubbing_moves_every_cursor(opened):
    read = """() => Plots.all().map(({ plot, u, cursor, readouts }) => ({
        name: plot.name,
        share: new DOMMatrix(cursor.style.transform).e / u.over.clientWidth,
        seen: cursor.style.visibility,
        values: readouts.map(({ value }) => value.textContent).join(" "),
    }))"""
    end = opened.do("Clock.end()")
    road = "document.querySelector('.road canvas').toDataURL()"
    pictures, values = set(), {}
    for share in (0.2, 0.5, 0.8):
        scrub(opened, share * end)
        assert abs(opened.time() - share * end) < 0.011
        for plot in opened.do(read):
            assert abs(plot["share"] - share) < 0.01, f"{plot} at {share}"
            assert plot["seen"] == "visible", plot
            values.setdefault(plot["name"], set()).add(plot["values"])
        pictures.add(opened.do(road))
    assert len(pictures) == 3, "the road does not move"
    still = [name for name in ("speed_mps", "y_m", "predecessor_delay_s") if len(values[name]) < 2]
    assert not still, f"the values of {still} do not follow the time"


def zooming_one_plot_zooms_all(opened):
    place = opened.page.locator("#plot-speed_mps .u-over")
    place.scroll_into_view_if_needed()
    box = place.bounding_box()
    middle = box["y"] + box["height"] / 2
    opened.page.mouse.move(box["x"] + 0.25 * box["width"], middle)
    opened.page.mouse.down()
    opened.page.mouse.move(box["x"] + 0.75 * box["width"], middle, steps=4)
    opened.page.mouse.up()
    spans = opened.do("Plots.all().map(({ u }) => [u.scales.x.min, u.scales.x.max])")
    end = opened.do("Clock.end()")
    for low, high in spans:
        assert abs(low - 0.25 * end) < 0.02 * end and abs(high - 0.75 * end) < 0.02 * end, spans
    opened.page.keyboard.press("z")
    assert opened.do("Plots.all()[0].u.scales.x.max") == end


def keys_do_what_they_say(opened):
    opened.do("document.activeElement.blur()")
    scrub(opened, 1.0)
    opened.page.keyboard.press("ArrowRight")
    assert abs(opened.time() - 1.1) < 0.011, opened.time()
    opened.page.keyboard.press("Space")
    opened.page.wait_for_function("Clock.time() > 1.3")
    opened.page.keyboard.press("Space")
    opened.page.keyboard.press("1")
    shown = opened.do("Plots.all().map(({ u, lines }) => "
                      "lines.map((line, i) => line.truck !== 1 || !u.series[i + 1].show))")
    assert all(all(plot) for plot in shown), "truck 1 is still shown"
    opened.page.keyboard.press("1")
    before = opened.do("document.documentElement.dataset.theme")
    opened.page.keyboard.press("d")
    assert opened.do("document.documentElement.dataset.theme") != before


def whole(browser, path):
    """Everything of a page with its summary."""
    opened = Opened(browser, path, viewport={"width": 1280, "height": 900})
    missing = [name for name in SECTIONS if opened.page.locator(f"#{name}").count() == 0]
    assert not missing, f"sections missing: {missing}"
    assert opened.page.locator(".badge").inner_text() in ("PASS", "FAIL")
    every_plot_has_its_curves(opened, 1)
    scrubbing_moves_every_cursor(opened)
    zooming_one_plot_zooms_all(opened)
    keys_do_what_they_say(opened)
    assert len(opened.page.pdf()) > 10_000, "nothing to print"
    opened.close()
    return opened


def small(browser, path):
    """A phone: nothing wider than the screen; a link to an instant opens there."""
    opened = Opened(browser, path, "#t=5.5", viewport={"width": 390, "height": 844},
                    color_scheme="dark", has_touch=True)
    assert abs(opened.time() - 5.5) < 1e-6, opened.time()
    assert opened.do("document.documentElement.dataset.theme") == "dark"
    width = opened.do("document.documentElement.scrollWidth")
    assert width <= 390, f"{width} px wide on a screen of 390"
    every_plot_has_its_curves(opened, 1)
    opened.close()


def bare(browser, path):
    """A trace without its summary: what is known is shown, nothing else is missed."""
    opened = Opened(browser, path)
    assert opened.page.locator("#movement").count() == 1
    assert opened.page.locator("#criteria").count() == 0
    opened.close()


def pair(browser, path):
    opened = Opened(browser, path)
    assert opened.page.locator(".headline").count() == 2
    assert opened.page.locator(".road canvas").count() == 2
    every_plot_has_its_curves(opened, 2)
    scrubbing_moves_every_cursor(opened)
    opened.close()


def timed(browser, path):
    """The trace alone of a run in real time: every phase against the curve of the machine's floor."""
    opened = Opened(browser, path)
    assert not path.with_name("floor.json").exists(), "the floor is to come from the trace"
    shapes = opened.do(
        """() => Object.fromEntries(
            [...document.querySelectorAll(".latencies tbody tr")].map((row) => [
                row.querySelector("th").textContent,
                [...row.querySelectorAll("path")].map((path) =>
                    [path.getAttribute("class"), path.getAttribute("d").split("L").length]),
            ]))"""
    )
    floor = shapes.pop("machine alone")
    assert [kind for kind, _ in floor] == ["histogram"] and floor[0][1] > 4, floor
    assert {"whole tick", "wake", "qp", "send"} <= set(shapes), list(shapes)
    for phase, drawn in shapes.items():
        assert [kind for kind, _ in drawn] == ["histogram", "machine"], f"{phase}: {drawn}"
        assert drawn[1][1] == floor[0][1], f"{phase}: another floor than the machine's"
    values = opened.page.locator(".latencies .floor td.number").all_inner_texts()
    assert len(values) == 5 and "–" not in values, values
    opened.close()


def make(platoon, scratch):
    """The pages: of a run, of its trace alone, of two runs, of a trace of real time."""
    runs = [scratch / name for name in ("first", "second")]
    for seed, run in enumerate(runs, start=1):
        rehearse(platoon, run, "--virtual-time", "--duration-s", "45", "--seed", str(seed))
    real = scratch / "real"
    rehearse(platoon, real, "--bus", "udp", "--duration-s", "4")
    traces = [run / "run.mcap" for run in runs]
    subprocess.run([platoon, "report", *traces, "-o", scratch / "pair.html"], check=True)
    return (runs[0] / "report.html", report_alone(platoon, runs[0]), scratch / "pair.html",
            report_alone(platoon, real))


def rehearse(platoon, run, *words):
    subprocess.run(
        [platoon, "rehearse", "obstacle-avoidance", "--rate-hz", "20", *words, "--out", run],
        check=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )


def report_alone(platoon, run):
    """The page of a run of which nothing is left but its trace."""
    alone = run.with_name(f"{run.name}-alone")
    alone.mkdir(parents=True)
    shutil.copy(run / "run.mcap", alone)
    subprocess.run([platoon, "report", alone / "run.mcap"], check=True)
    return alone / "report.html"


def main():
    platoon, scratch = Path(sys.argv[1]), Path(sys.argv[2]).resolve()
    of_run, of_trace, of_pair, of_real = make(platoon, scratch)
    with sync_playwright() as playwright:
        # Its sandbox needs a user other than root.
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        opened = whole(browser, of_run)
        small(browser, of_run)
        bare(browser, of_trace)
        pair(browser, of_pair)
        timed(browser, of_real)
        browser.close()
    size_kib = of_run.stat().st_size // 1024
    print(f"report: {size_kib} KiB, drawn {opened.drawn_ms} ms after opening, all of it after "
          f"{opened.complete_ms} ms; curves, cursors, zoom, keys, phone, print, trace alone, two runs "
          "and the machine's floor as they should be")


if __name__ == "__main__":
    main()
