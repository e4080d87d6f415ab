//! A table in LaTeX, for documents that load `booktabs`.

use super::{Grid, Intervals, Part, prose};

/// A floating table with the label `tab:NAME`.
#[must_use]
pub fn latex(grid: &Grid, name: &str) -> String {
    let parts = grid.parts();
    let header =
        std::iter::once(escape(grid.corner())).chain(parts.iter().map(|part| escape(grid.heading(*part))));
    let body: String = (0..grid.rows.len())
        .map(|row| format!("    {} \\\\\n", line(grid, row, &parts)))
        .collect();
    let notes: String = grid
        .footnotes(Intervals::InBrackets)
        .iter()
        .map(|note| format!("  \\par\\footnotesize {}\n", prose::latex(note)))
        .collect();
    format!(
        "\\begin{{table}}\n  \\centering\n  \\caption{{{caption}}}\n  \\label{{tab:{label}}}\n  \
         \\begin{{tabular}}{{l{columns}}}\n    \
         \\toprule\n    {header} \\\\\n    \\midrule\n{body}    \\bottomrule\n  \
         \\end{{tabular}}\n{notes}\\end{{table}}\n",
        caption = prose::latex(&grid.caption),
        label = name.replace(|c: char| !c.is_ascii_alphanumeric() && !".:-".contains(c), "-"),
        columns = parts
            .iter()
            .map(|part| if matches!(part, Part::Verdict(_)) {
                'l'
            } else {
                'r'
            })
            .collect::<String>(),
        header = header.collect::<Vec<_>>().join(" & "),
    )
}

fn line(grid: &Grid, row: usize, parts: &[Part]) -> String {
    let cells = parts.iter().map(|part| match part {
        Part::Verdict(_) if grid.text(row, *part).is_empty() => String::new(),
        Part::Verdict(_) => format!("\\textsc{{{}}}", escape(&grid.text(row, *part).to_lowercase())),
        Part::Value(_) | Part::Published(_) => signs(&escape(&grid.text(row, *part))),
    });
    std::iter::once(escape(&grid.rows[row].label))
        .chain(cells)
        .collect::<Vec<_>>()
        .join(" & ")
}

/// Hyphens before digits as minus signs.
fn signs(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text.chars().peekable();
    while let Some(character) = rest.next() {
        let is_sign = character == '-' && rest.peek().is_some_and(char::is_ascii_digit);
        if is_sign {
            out.push_str("$-$");
        } else {
            out.push(character);
        }
    }
    out
}

/// Text with the characters that LaTeX reads as commands made plain.
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
            '\n' | '\r' => out.push(' '),
            _ => out.push(character),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signs_and_special_characters() {
        assert_eq!(signs(&escape("-1.5 [-2, 1e-5]")), "$-$1.5 [$-$2, 1e$-$5]");
        assert_eq!(signs(&escape("–")), "--");
        assert_eq!(
            escape("a_b & 5 % of {c} ~ d^2 \\ #1 $"),
            "a\\_b \\& 5 \\% of \\{c\\} \\textasciitilde{} d\\textasciicircum{}2 \\textbackslash{} \\#1 \\$"
        );
    }
}
