//! The short form of a report, for a terminal.

use super::{Contents, StudyInfo, Verdicts, Word, basis, budgets, claims, head, passed::words, sentence};
use analysis::results::Results;
use presentation::table::{Grid, terminal, terminal_in_short, wrap};
use std::path::Path;

/// The most claims in the first screen.
const FIRST_CLAIMS: usize = 6;
/// Width in characters of the word before an answer or a claim.
const WORD: usize = 20;

/// The report as plain text of at most `width` characters a line: the answers, the first table and the path of the
/// page. With `all` it contains everything.
#[must_use]
pub fn summary(
    study: &StudyInfo,
    results: &Results,
    contents: &Contents,
    page: &Path,
    width: usize,
    everything: bool,
) -> String {
    let title = match study.title.as_str() {
        "" => &study.name,
        title => title,
    };
    let mut parts = vec![wrap(title, width)];
    parts.extend(study.asked_with().map(|options| wrap(&options, width)));
    parts.extend(study.rehearsal().map(|banner| wrap(banner, width)));
    parts.extend(study.outdated().iter().map(|sentence| wrap(sentence, width)));
    let answers = if everything {
        None
    } else {
        answers(study, results, contents, width)
    };
    if answers.is_none() {
        parts.extend(sentence(study, contents).map(|sentence| wrap(&sentence, width)));
    }
    parts.extend(answers);
    let shown = if everything { contents.tables.len() } else { 1 };
    let table = |(index, (name, grid)): (usize, &(String, Result<Grid, String>))| match grid {
        Ok(_) if index >= shown => None,
        Ok(grid) if everything => Some(format!("{name}\n{}", terminal(grid, width).trim_end())),
        Ok(grid) => Some(format!("{name}\n{}", terminal_in_short(grid, width).trim_end())),
        Err(reason) => Some(wrap(&format!("{name}: could not be made: {reason}"), width)),
    };
    parts.extend(contents.tables.iter().enumerate().filter_map(table));
    let failed = contents
        .figures
        .iter()
        .filter(|(name, _)| !contents.kept.contains_key(name))
        .filter_map(|(name, chart)| chart.as_ref().err().map(|reason| (name, reason)));
    parts.extend(failed.map(|(name, reason)| wrap(&format!("{name}: could not be drawn: {reason}"), width)));
    if everything && !contents.claims.is_empty() {
        parts.push(verdicts(contents, width));
    }
    parts.push(last_lines(study, results, contents, page, width, everything));
    parts.join("\n\n") + "\n"
}

/// A summary with verdicts and answers in the colours of a terminal: green for those that hold, red for those that do
/// not, and yellow for open ones.
#[must_use]
pub fn tinted(text: &str) -> String {
    const GREEN: &str = "\x1b[32m";
    const RED: &str = "\x1b[31m";
    const YELLOW: &str = "\x1b[33m";
    let colour_of = |word: &str| match word {
        "REPRODUCED" | "SUPPORTED" | "yes" => GREEN,
        "DIFFERS" | "REFUTED" | "no" => RED,
        _ => YELLOW,
    };
    let tint = |line: &str, word: &str| line.replace(word, &format!("{}{word}\x1b[0m", colour_of(word)));
    let line = |line: &str| {
        // An answer stands at the beginning of a line, followed by spaces.
        let mut answers = Word::ALL.map(Word::text).into_iter();
        let answer = answers.find(|answer| {
            line.strip_prefix(answer)
                .is_some_and(|rest| rest.starts_with("  "))
        });
        let rest = answer.map_or(line, |answer| &line[answer.len()..]);
        let rest = words()
            .into_iter()
            .fold(rest.to_owned(), |rest, word| tint(&rest, word));
        answer.map_or(String::new(), |answer| tint(answer, answer)) + &rest
    };
    text.lines().map(line).collect::<Vec<_>>().join("\n")
}

/// The answers of the study, or its first claims; `None` where it has a sentence instead, or neither.
fn answers(study: &StudyInfo, results: &Results, contents: &Contents, width: usize) -> Option<String> {
    let line = |word: &str, text: &str| {
        let text = wrap(text, width.saturating_sub(WORD).max(20));
        format!(
            "{word:<WORD$}{}",
            text.replace('\n', &format!("\n{}", " ".repeat(WORD)))
        )
    };
    let judged = Verdicts::of(study, results, contents);
    let answered = judged.answers.iter().map(|answered| {
        let word = answered.word(&judged).map_or("", Word::text);
        match answered.here.as_str() {
            "" => line(word, &answered.printed),
            here => line(word, &format!("{}: {here}", answered.printed)),
        }
    });
    let mut lines: Vec<String> = answered.collect();
    if lines.is_empty() && sentence(study, contents).is_none() {
        let claims = contents.claims.iter();
        for it in claims.clone().take(FIRST_CLAIMS) {
            let is_alone = claims.clone().filter(|other| other.number == it.number).count() == 1;
            let claim = if is_alone {
                it.spec.claim.clone()
            } else {
                it.in_place()
            };
            lines.push(match it.together() {
                Some(together) => line(together.word(), &format!("{claim} (alone: {})", it.word())),
                None => line(it.word(), &claim),
            });
        }
        if claims.len() > FIRST_CLAIMS {
            lines.push(line(
                "",
                &format!("and {} more claims", claims.len() - FIRST_CLAIMS),
            ));
        }
    }
    (!lines.is_empty()).then(|| lines.join("\n"))
}

fn last_lines(
    study: &StudyInfo,
    results: &Results,
    contents: &Contents,
    page: &Path,
    width: usize,
    everything: bool,
) -> String {
    let mut last: Vec<String> = budgets::untrained(results);
    if everything {
        last.push(basis(study, results, contents));
    }
    last.extend(counts(study, contents));
    last.extend(contents.cost(results).known().map(|time| format!("Time: {time}")));
    if everything {
        let profiles = study.profiles.iter();
        last.extend(profiles.map(|it| format!("Profile {}: {}", it.name(), it.sentence())));
    }
    let mut last: Vec<String> = last.iter().map(|line| wrap(line, width)).collect();
    last.push(format!("Report: {}", page.display()));
    if !everything {
        last.push("        (all tables and claims here: `--verbose`)".into());
    }
    last.join("\n")
}

fn verdicts(contents: &Contents, width: usize) -> String {
    let line = |line: &super::ClaimLine| {
        let numbers = line.numbers();
        let numbers = if numbers.is_empty() {
            String::new()
        } else {
            format!(": difference {numbers}")
        };
        let together = line
            .together()
            .map(|outcome| format!("all claims together (Holm): {outcome}"));
        let notes: String = line
            .notes()
            .into_iter()
            .chain(together)
            .map(|note| format!("; {note}"))
            .collect();
        let text = wrap(
            &format!("{}{numbers}{notes}", line.in_place()),
            width.saturating_sub(14).max(20),
        );
        format!("{:<12}  {}", line.word(), text.replace('\n', "\n              "))
    };
    let notes = claims::notes(contents).into_iter().map(|note| wrap(&note, width));
    contents
        .claims
        .iter()
        .map(line)
        .chain(notes)
        .collect::<Vec<_>>()
        .join("\n")
}

fn counts(study: &StudyInfo, contents: &Contents) -> Vec<String> {
    let line = |counts: &head::CountLine| {
        let words: Vec<String> = counts
            .words
            .iter()
            .map(|(word, n)| format!("{n} {word}"))
            .collect();
        format!("{}: {}", counts.what, words.join(", "))
    };
    head::lines(study, contents).iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verdicts_and_answers_are_coloured_and_nothing_else() {
        let text = "yes           it holds: 3\nno doubt\na  REPRODUCED  DIFFERS (Holm: INCONCLUSIVE)";
        let expected = "\x1b[32myes\x1b[0m           it holds: 3\nno doubt\na  \x1b[32mREPRODUCED\x1b[0m  \
                        \x1b[31mDIFFERS\x1b[0m (Holm: \x1b[33mINCONCLUSIVE\x1b[0m)";
        assert_eq!(tinted(text), expected);
        let longest = "not at this budget  it fails: 2";
        assert!(tinted(longest).starts_with("\x1b[33mnot at this budget\x1b[0m  it"));
    }
}
