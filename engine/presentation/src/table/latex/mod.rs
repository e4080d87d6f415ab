//! A table in LaTeX, for documents that load `booktabs`, and `rotating` if a table is turned.

mod best;
mod layout;
#[cfg(test)]
mod tests;
mod typeset;
mod width;

pub use layout::{BestScope, Direction, LatexLayout, ValueForm, WideTable};

use super::{Grid, Intervals, prose};
use best::best;
use typeset::Column;

/// TeX's points in a millimetre.
const POINTS_PER_MM: f64 = 72.27 / 25.4;

/// A floating table with the label `tab:NAME`, typeset as the study states.
#[must_use]
pub fn latex(grid: &Grid, name: &str) -> String {
    let layout = grid.latex.clone().unwrap_or_else(|| LatexLayout {
        wide: WideTable::Keep,
        ..LatexLayout::default()
    });
    let columns = typeset::columns(grid, &layout, &best(grid, &layout));
    let (environment, room) = float(&columns, &layout);
    let tabulars: Vec<String> = typeset::split(&columns, room)
        .iter()
        .map(|columns| tabular(grid, columns))
        .collect();
    let notes: String = notes(grid, &layout)
        .iter()
        .map(|note| format!("  \\par\\footnotesize {}\n", prose::latex(note)))
        .collect();
    format!(
        "\\begin{{{environment}}}\n  \\centering\n  \\caption{{{caption}}}\n  \\label{{tab:{label}}}\n\
         {tabulars}{notes}\\end{{{environment}}}\n",
        caption = prose::latex(&grid.caption),
        label = name.replace(|c: char| !c.is_ascii_alphanumeric() && !".:-".contains(c), "-"),
        tabulars = tabulars.join("  \\par\\medskip\n"),
    )
}

/// The environment of a floating table, and its largest width there in points.
fn float(columns: &[Column], layout: &LatexLayout) -> (&'static str, f64) {
    let text = layout.text_width_mm * POINTS_PER_MM;
    match layout.wide {
        WideTable::Keep => ("table", f64::INFINITY),
        WideTable::Turn if typeset::width(columns) > text => {
            ("sidewaystable", layout.text_height_mm * POINTS_PER_MM)
        }
        WideTable::Split | WideTable::Turn => ("table", text),
    }
}

fn tabular(grid: &Grid, columns: &[&Column]) -> String {
    let line = |cells: Vec<&str>| format!("    {} \\\\\n", cells.join(" & "));
    let kinds: String = columns.iter().map(|column| column.kind).collect();
    let header = line(columns.iter().map(|column| column.heading.as_str()).collect());
    let row = |row: usize| line(columns.iter().map(|column| column.cells[row].as_str()).collect());
    let body: String = (0..grid.rows.len()).map(row).collect();
    format!(
        "  \\begin{{tabular}}{{{kinds}}}\n    \\toprule\n{header}    \\midrule\n{body}    \\bottomrule\n  \
         \\end{{tabular}}\n"
    )
}

/// The sentences under the table: those on parts that are not printed are left out, and one on bold values is added.
fn notes(grid: &Grid, layout: &LatexLayout) -> Vec<String> {
    let intervals = match layout.value {
        ValueForm::Brackets | ValueForm::SmallInterval => Intervals::InBrackets,
        ValueForm::HalfWidth => Intervals::AsHalfWidth,
        ValueForm::Alone => Intervals::NotShown,
    };
    let mut notes = if layout.verdicts {
        grid.footnotes(intervals)
    } else {
        without_verdicts(grid).footnotes(intervals)
    };
    if layout.bold_best {
        let line = match best::of(grid, layout) {
            BestScope::Row => "row",
            BestScope::Column => "column",
        };
        let directions = |wanted| grid.better.iter().flatten().any(|it| *it == wanted);
        let which = match (directions(Direction::Higher), directions(Direction::Lower)) {
            (true, false) => " (more is better)",
            (false, true) => " (less is better)",
            _ => "",
        };
        notes.push(format!(
            "Bold: the best value of a {line}{which}, and all whose interval overlaps its own."
        ));
    }
    notes
}

/// The table without published values, for its sentences.
fn without_verdicts(grid: &Grid) -> Grid {
    let mut grid = grid.clone();
    for cell in grid.cells.iter_mut().flatten() {
        (cell.judgement, cell.calibrated_on, cell.seen_at) = (None, None, None);
        cell.first_judged_by = None;
    }
    grid
}

/// Text with LaTeX's special characters escaped.
#[must_use]
pub fn escape(text: &str) -> String {
    let mut out = String::new();
    for character in text.chars() {
        match character {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => out.extend(['\\', character]),
            '\\' => out.push_str("\\textbackslash{}"),
            '~' => out.push_str("\\textasciitilde{}"),
            '^' => out.push_str("\\textasciicircum{}"),
            '<' => out.push_str("\\textless{}"),
            '>' => out.push_str("\\textgreater{}"),
            '–' => out.push_str("--"),
            '—' => out.push_str("---"),
            '\u{2212}' => out.push_str("$-$"),
            '\n' | '\r' => out.push(' '),
            _ => match symbol(character) {
                Some(command) => out.extend(["$\\", command, "$"]),
                None => out.push(character),
            },
        }
    }
    out
}

/// The command of a symbol that LaTeX has only in formulas.
fn symbol(character: char) -> Option<&'static str> {
    Some(match character {
        '×' => "times",
        '·' => "cdot",
        '≤' => "le",
        '≥' => "ge",
        '≠' => "ne",
        '≈' => "approx",
        '→' => "to",
        '∞' => "infty",
        'α' => "alpha",
        'β' => "beta",
        'γ' => "gamma",
        'δ' => "delta",
        'ε' => "varepsilon",
        'η' => "eta",
        'θ' => "theta",
        'λ' => "lambda",
        'μ' => "mu",
        'π' => "pi",
        'ρ' => "rho",
        'σ' => "sigma",
        'τ' => "tau",
        'φ' => "varphi",
        'ω' => "omega",
        'Δ' => "Delta",
        'Σ' => "Sigma",
        _ => return None,
    })
}
