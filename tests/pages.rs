//! Pages in a real browser without a window: that they fit a phone, a desk and a sheet of paper, and that they say the
//! same with and without scripts.

use crate::{
    needs,
    program::{Bench, trial_files},
};
use serde_json::Value;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    process::Command,
    sync::LazyLock,
};

/// Names of the browser, as distributions have it.
const BROWSERS: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];
/// A phone, a tablet and a desk, in pixels.
const WIDTHS: [u32; 3] = [360, 800, 1400];
/// The heading of the last column of a table with more columns than a screen or a sheet of paper has room for.
const LAST: &str = "lastrule";

/// A study with a wide table, learning curves and something folded.
const STUDY: &str = "
study: NAME
title: Pages <and> \"print\"
source: a table with many columns
environments:
  two_cells: { battery: { cells: 2 } }
  three_cells: { battery: { cells: 3 } }
agents:
  dsac: { dirichlet_sac: { width: 16, batch_size: 16, learning_starts: 64 } }
RULES  lastrule: { equal_split: {} }
protocol: { train_evaluate: { steps: 256, environments: 8, evaluate_every: 64, episodes: 2, final_episodes: 6 } }
seeds: 3
summary: \"A split lives {lengths: two_cells, lastrule} decisions.\"
deviations: [\"There is no `paper` behind it.\"]
tables:
  lengths:
    caption: All rules.
    comparison: { value: cycle_length, rows: environment }
figures:
  curve:
    caption: Lengths </script> while learning.
    learning_curve: { metric: cycle_length, agents: [dsac, lastrule] }
    labels: { dsac: \"</script> & co\" }
  bars:
    bars: { of: { value: cycle_length, rows: environment, agents: [dsac, lastrule] } }
claims:
  - dsac.cycle_length > 0
";

/// The study with this name and so many more rules.
fn study(name: &str, rules: usize) -> String {
    let rule = |number| format!("  rule_{number}: {{ equal_split: {{}} }}\n");
    let rules: String = (0..rules).map(rule).collect();
    STUDY.replace("NAME", name).replace("RULES", &rules)
}

/// Both studies, run once for all tests, with their pages and the index over them.
static STUDIES: LazyLock<Bench> = LazyLock::new(|| {
    let bench = Bench::new();
    bench.write("pages.yaml", &study("pages", 16));
    bench.write("small.yaml", &study("small", 0));
    bench.ok(&["run", "pages.yaml", "small.yaml"]);
    bench
});

/// The browser; `None`, after a line, where there is none.
fn browser() -> Option<PathBuf> {
    needs::one_of(&BROWSERS)
}

fn page(name: &str) -> String {
    std::fs::read_to_string(STUDIES.path(name)).unwrap()
}

/// Writes a page beside the one of the first study and lets the browser do something with it; what it printed, and
/// what its console said.
fn visit(browser: &Path, html: &str, arguments: &[&str]) -> (String, String) {
    let folder = tempfile::tempdir_in(STUDIES.path("results")).unwrap();
    let path = folder.path().join("page.html");
    std::fs::write(&path, html).unwrap();
    let profile = format!("--user-data-dir={}", folder.path().join("profile").display());
    let output = Command::new(browser)
        .args([
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--virtual-time-budget=4000",
        ])
        .args(["--enable-logging=stderr", &profile])
        .args(arguments)
        .arg(format!("file://{}", path.display()))
        .current_dir(folder.path())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    let console = said
        .lines()
        .filter(|line| line.contains(":CONSOLE"))
        .collect::<Vec<_>>()
        .join("\n");
    (String::from_utf8_lossy(&output.stdout).into_owned(), console)
}

/// The document that comes of a page.
fn document(browser: &Path, html: &str) -> (String, String) {
    visit(browser, html, &["--dump-dom"])
}

/// Shows a page in a frame of some width, lets `script` look at it, and gives back what it returns. A window has a
/// smallest width, which a frame has not.
fn ask(browser: &Path, html: &str, width: u32, script: &str) -> Value {
    let asking = format!(
        "<script>addEventListener('load', () => setTimeout(() => {{ const answer = (() => {{ {script} }})(); \
         setTimeout(() => Promise.resolve(typeof answer === 'function' ? answer() : answer) \
         .then(it => parent.postMessage(JSON.stringify(it), '*')), 200); }}, 200))</script></body>"
    );
    let folder = tempfile::tempdir_in(STUDIES.path("results")).unwrap();
    let inner = folder.path().join("inner.html");
    std::fs::write(&inner, html.replace("</body>", &asking)).unwrap();
    let outer = format!(
        "<!DOCTYPE html><body style=\"margin:0\"><iframe src=\"file://{}\" style=\"width:{width}px;height:900px;border:0\">\
         </iframe><p id=\"said\"></p><script>addEventListener('message', event => {{ \
         document.getElementById('said').textContent = event.data; }})</script>",
        inner.display()
    );
    let (dom, console) = document(browser, &outer);
    assert_eq!(console, "", "at {width} pixels");
    let said = dom
        .split_once("<p id=\"said\">")
        .and_then(|(_, rest)| rest.split_once("</p>"))
        .unwrap_or_else(|| panic!("{dom}"))
        .0;
    let said = said
        .replace("&lt;", "<")
        .replace("&gt;", ">")
        .replace("&amp;", "&");
    serde_json::from_str(&said).unwrap_or_else(|error| panic!("{error}: {said}"))
}

const OVERFLOW: &str = "const root = document.documentElement;
    const scrolls = element => { for (let it = element.parentElement; it; it = it.parentElement)
        if (getComputedStyle(it).overflowX !== 'visible') return true; return false; };
    const out = [...document.querySelectorAll('main *')].filter(it => it.getBoundingClientRect().right > innerWidth + 1
        && !scrolls(it)).map(it => it.tagName);
    return { scroll: root.scrollWidth, inner: innerWidth, out: out.slice(0, 5) };";

#[test]
fn no_page_is_wider_than_its_window() {
    let Some(browser) = &browser() else { return };
    for name in [
        "results/pages/index.html",
        "results/small/index.html",
        "results/index.html",
    ] {
        let html = page(name);
        for width in WIDTHS {
            let told = ask(browser, &html, width, OVERFLOW);
            let (scroll, inner) = (told["scroll"].as_u64().unwrap(), told["inner"].as_u64().unwrap());
            assert_eq!(inner, u64::from(width));
            assert!(
                scroll <= inner,
                "{name} at {width} pixels is {scroll} wide: {}",
                told["out"]
            );
        }
    }
    // The test can fail.
    let wide = page("results/pages/index.html").replace("overflow-x: auto", "overflow-x: visible");
    let told = ask(browser, &wide, 360, OVERFLOW);
    assert!(told["scroll"].as_u64() > told["inner"].as_u64(), "{told}");
}

/// A page whose scripts are not run.
fn silent(html: &str) -> String {
    html.replace("script-src 'unsafe-inline'", "script-src 'none'")
}

/// The lines of a page on paper, each of its words with the place of its end in parts of the sheet's width.
fn on_paper(browser: &Path, html: &str) -> Option<Vec<Vec<(String, f64)>>> {
    let pdftotext = needs::program("pdftotext")?;
    let folder = tempfile::tempdir().unwrap();
    let (pdf, text) = (folder.path().join("page.pdf"), folder.path().join("page.txt"));
    let print = format!("--print-to-pdf={}", pdf.display());
    visit(browser, html, &["--no-pdf-header-footer", &print]);
    let status = Command::new(pdftotext).arg("-bbox").args([&pdf, &text]).status();
    assert!(status.unwrap().success());
    Some(lines(&std::fs::read_to_string(&text).unwrap()))
}

/// Words that stand beside each other.
fn lines(boxes: &str) -> Vec<Vec<(String, f64)>> {
    let number = |line: &str, name: &str| -> f64 {
        let (_, rest) = line.split_once(&format!("{name}=\"")).unwrap();
        rest.split('"').next().unwrap().parse().unwrap()
    };
    let (mut sheet, mut width) = (0, f64::NAN);
    let mut lines: BTreeMap<(u32, String), Vec<(String, f64)>> = BTreeMap::new();
    for line in boxes.lines().map(str::trim) {
        if line.starts_with("<page ") {
            (sheet, width) = (sheet + 1, number(line, "width"));
        } else if line.starts_with("<word ") {
            let text = line.split_once('>').unwrap().1.trim_end_matches("</word>");
            let place = (sheet, format!("{:.0}", number(line, "yMin")));
            lines
                .entry(place)
                .or_default()
                .push((text.to_owned(), number(line, "xMax") / width));
        }
    }
    lines.into_values().collect()
}

#[test]
fn on_paper_every_column_is_on_the_sheet_and_nothing_is_folded() {
    let Some(browser) = &browser() else { return };
    let html = silent(&page("results/pages/index.html"));
    let Some(lines) = on_paper(browser, &html) else {
        return;
    };
    let has =
        |line: &[(String, f64)], wanted: &str| line.iter().any(|(word, end)| word == wanted && *end < 0.99);
    let is_heading =
        |line: &Vec<(String, f64)>| ["dsac", "rule_0", "rule_15", LAST].iter().all(|it| has(line, it));
    let is_folded = |line: &Vec<(String, f64)>| ["cell", "seed"].iter().all(|it| has(line, it));
    let cut: Vec<_> = lines.iter().flatten().filter(|(_, end)| *end > 0.99).collect();
    assert!(cut.is_empty(), "{cut:?}");
    assert!(
        lines.iter().any(is_heading) && lines.iter().any(is_folded),
        "{lines:?}"
    );
    // Without its rules for paper the same page is cut and folded.
    let plain = html
        .replace("@media print", "@media speech")
        .replace("@page turned", "@page other");
    let lines = on_paper(browser, &plain).unwrap();
    assert!(
        !lines.iter().any(is_heading) && !lines.iter().any(is_folded),
        "{lines:?}"
    );
}

#[test]
fn without_scripts_all_is_there() {
    let Some(browser) = &browser() else { return };
    let (dom, _) = document(browser, &silent(&page("results/pages/index.html")));
    assert!(!dom.contains(" plotted\"") && !dom.contains("<canvas"));
    assert_eq!(dom.matches("<svg role=\"img\" aria-label=\"").count(), 2);
    for text in [
        "Pages &lt;and&gt; \"print\"",
        "decisions.",
        LAST,
        "There is no <code>paper</code>",
        "SUPPORTED",
    ] {
        assert!(dom.contains(text), "{text}");
    }
    let alt = "aria-label=\"Curves in 2 panels (two_cells, three_cells): cycle length";
    assert!(dom.contains(alt), "{alt}");
}

/// Moves the pointer into the first plot, and tells what is said; then shows the axis with logarithms.
const POINT: &str = "const over = document.querySelector('.u-over'), place = over.getBoundingClientRect();
    const at = { clientX: place.left + 0.6 * place.width, clientY: place.top + 0.3 * place.height, bubbles: true };
    over.dispatchEvent(new MouseEvent('mouseenter', at));
    over.dispatchEvent(new MouseEvent('mousemove', at));
    return () => {
        const texts = query => [...document.querySelectorAll(query)].map(it => it.textContent);
        const told = { plots: texts('.plot canvas').length, values: texts('.legend output'), trace: texts('.trace')[0],
            trial: texts('.trace code')[0], hidden: getComputedStyle(document.querySelector('figure.plotted > svg')).display };
        const boxes = [...document.querySelectorAll('.bar input[type=checkbox]')];
        boxes.forEach(box => box.click());
        document.querySelector('.legend input').click();
        told.after = texts('.plot canvas').length;
        document.querySelector('.bar button').click();
        told.shown = getComputedStyle(document.querySelector('figure.plotted > svg')).display;
        return told;
    };";

#[test]
fn with_scripts_learning_curves_answer() {
    let Some(browser) = &browser() else { return };
    let told = ask(browser, &page("results/pages/index.html"), 1400, POINT);
    assert_eq!((&told["plots"], &told["after"]), (&2.into(), &2.into()), "{told}");
    assert_eq!(
        (&told["hidden"], &told["shown"]),
        (&"none".into(), &"block".into()),
        "{told}"
    );
    let values: Vec<&str> = told["values"]
        .as_array()
        .unwrap()
        .iter()
        .filter_map(Value::as_str)
        .collect();
    assert!(
        values.len() == 2 && values.iter().all(|it| it.parse::<f64>().is_ok()),
        "{told}"
    );
    assert!(
        told["trace"].as_str().unwrap().starts_with("two_cells, "),
        "{told}"
    );
    if let Some(trial) = told["trial"].as_str() {
        let files = trial_files(&STUDIES.path("store"));
        let name = |file: &Path| {
            file.parent()
                .unwrap()
                .file_name()
                .unwrap()
                .to_string_lossy()
                .into_owned()
        };
        assert!(files.iter().any(|file| name(file) == trial), "{trial}");
    }
    // A page without learning curves has no script.
    assert!(!page("results/index.html").contains("<script"));
}

/// Points at the left end of the first plot with a finger, before and after two fingers were spread in its middle.
const SPREAD: &str = "const over = document.querySelector('.u-over'), place = over.getBoundingClientRect();
    const touch = (kind, shares) => {
        const touches = shares.map((share, identifier) => new Touch({ identifier, target: over,
            clientX: place.left + share * place.width, clientY: place.top + 0.4 * place.height }));
        const event = new TouchEvent(kind, { touches, bubbles: true, cancelable: true });
        return over.dispatchEvent(event);
    };
    const step = () => document.querySelector('.trace').textContent.match(/ at (\\S+) /)[1];
    touch('touchstart', [0.01]);
    return () => {
        const before = step();
        touch('touchend', []);
        touch('touchstart', [0.6, 0.7]);
        const scrolls = touch('touchmove', [0.1, 0.9]);
        touch('touchend', []);
        return new Promise(done => setTimeout(() => {
            touch('touchstart', [0.01]);
            setTimeout(() => done({ before, after: step(), scrolls }), 50);
        }, 50));
    };";

#[test]
fn two_fingers_stretch_the_axis_between_them() {
    let Some(browser) = &browser() else { return };
    let told = ask(browser, &page("results/pages/index.html"), 400, SPREAD);
    assert_eq!(
        (&told["before"], &told["scrolls"]),
        (&"0".into(), &false.into()),
        "{told}"
    );
    assert!(told["after"].as_str().is_some_and(|step| step != "0"), "{told}");
}

#[test]
fn several_studies_have_a_page_over_all_of_them() {
    let index = page("results/index.html");
    for part in [
        "<h2><a href=\"pages/index.html\">Pages &lt;and&gt; &quot;print&quot;</a></h2>",
        "<p>A split lives ",
        "<a href=\"small/index.html#curve\"><img loading=\"lazy\" src=\"small/figures/curve.svg\"",
        "<h2>Claims</h2><ul><li><b>2</b> <span class=\"word supported\">SUPPORTED</span></li></ul>",
        "<h2>Studies</h2><p>2</p>",
    ] {
        assert!(index.contains(part), "{part}\n{index}");
    }
    // It is made of the folders alone.
    STUDIES.ok(&["report", "pages.yaml", "small.yaml", "-o", "again"]);
    std::fs::remove_file(STUDIES.path("again/index.html")).unwrap();
    STUDIES.ok(&["overview", "again", "--page"]);
    assert_eq!(page("again/index.html"), index);
    let Some(browser) = &browser() else { return };
    let script =
        "return [...document.images].map(it => { it.loading = 'eager'; return it.getAttribute('src'); });";
    let images = ask(browser, &index, 1400, script);
    assert_eq!(images.as_array().unwrap().len(), 4, "{images}");
}

/// A study with runs of nine settings of another program, the later ones better.
fn crowd() -> Bench {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("runs")).unwrap();
    let mut imported = String::new();
    for setting in 0..9 {
        let values = (0..=600)
            .step_by(50)
            .map(|step| format!("{step},{}\n", setting * step));
        bench.write(
            &format!("runs/{setting}.csv"),
            &format!("step,return\n{}", values.collect::<String>()),
        );
        imported +=
            &format!("  rate_{setting}: {{ from: runs/{setting}.csv, metrics: {{ return: return }} }}\n");
    }
    let head = "study: crowd\nenvironments: { env: { pendulum: {} } }\nagents: { rule: { zero_action: {} } }\n\
        protocol: { train_evaluate: { steps: 200, evaluate_every: 100, episodes: 1, final_episodes: 1, \
        environments: 2, trace_episodes: 0 } }\n";
    let agents: Vec<String> = (0..9).map(|setting| format!("rate_{setting}")).collect();
    let figure = format!(
        "figures: {{ curve: {{ learning_curve: {{ metric: return, agents: [{}] }} }} }}\n",
        agents.join(", ")
    );
    bench.write("crowd.yaml", &format!("{head}imported:\n{imported}{figure}"));
    bench.ok(&["run", "crowd.yaml"]);
    bench
}

/// The names of the legend, and how much is drawn in the last column of pixels of a plot, where nothing may be cut.
const CROWDED: &str = "const canvas = document.querySelector('.plot canvas'), edge = canvas.width - 1;
    const pixels = canvas.getContext('2d').getImageData(edge, 0, 1, canvas.height).data;
    return { names: [...document.querySelectorAll('.legend label span')].map(it => it.textContent),
        drawn: pixels.filter((_, index) => index % 4 === 3).reduce((sum, it) => sum + it, 0) };";

#[test]
fn of_many_lines_the_best_are_named_and_the_last_tick_is_whole() {
    let Some(browser) = &browser() else { return };
    let bench = crowd();
    let html = std::fs::read_to_string(bench.path("results/crowd/index.html")).unwrap();
    let wanted = ["rate_4", "rate_5", "rate_6", "rate_7", "rate_8"].map(|name| format!("{name} (imported)"));
    for width in WIDTHS {
        let told = ask(browser, &html, width, CROWDED);
        let names: Vec<&str> = told["names"]
            .as_array()
            .unwrap()
            .iter()
            .filter_map(Value::as_str)
            .collect();
        assert_eq!(
            (&names[..5], names[5]),
            (&wanted.each_ref().map(String::as_str)[..], "4 others")
        );
        assert_eq!(told["drawn"], 0, "at {width} pixels");
    }
    let svg = std::fs::read_to_string(bench.path("results/crowd/figures/curve.svg")).unwrap();
    assert!(svg.contains("4 others") && !svg.contains("rate_3"));
}
