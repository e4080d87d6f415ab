//! How trials ended as JUnit XML, which continuous integration shows as tests: a suite per study, a test case
//! per trial.
//!
//! A trial whose plugin reported something (`failed`, `nan`) is a failure, one that broke or was ended
//! (`panicked`, `timeout`, `oom`, `killed`) an error, one that has not run is skipped.

use super::outcome::Outcome;
use contract::{
    Error,
    trial::Trial,
    trial_end::{EndState, TrialEnd},
};
use quick_xml::{
    Writer,
    events::{BytesDecl, BytesEnd, BytesStart, BytesText, Event},
};
use std::io;

/// The document for all studies of a command.
///
/// # Errors
/// [`Error::Render`] where the writer refuses.
pub fn junit(outcomes: &[Outcome], wall_s: f64, exit_code: u8) -> Result<String, Error> {
    let refused = |problem: String| Error::Render {
        what: "JUnit file".into(),
        problem,
    };
    let mut xml = Writer::new_with_indent(Vec::new(), b' ', 2);
    document(&mut xml, outcomes, wall_s, exit_code).map_err(|error| refused(error.to_string()))?;
    String::from_utf8(xml.into_inner())
        .map(|text| text + "\n")
        .map_err(|error| refused(error.to_string()))
}

type Xml = Writer<Vec<u8>>;

fn document(xml: &mut Xml, outcomes: &[Outcome], wall_s: f64, exit_code: u8) -> io::Result<()> {
    xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    let all: Vec<&Option<TrialEnd>> = outcomes
        .iter()
        .flat_map(|outcome| outcome.trials.iter().map(|(_, end)| end))
        .collect();
    let attributes = [("name", "regimen".to_owned())]
        .into_iter()
        .chain(totals(&all, wall_s));
    inside(xml, "testsuites", attributes, |xml| {
        outcomes
            .iter()
            .try_for_each(|outcome| suite(xml, outcome, exit_code))
    })
}

fn suite(xml: &mut Xml, outcome: &Outcome, exit_code: u8) -> io::Result<()> {
    let ends: Vec<_> = outcome.trials.iter().map(|(_, end)| end).collect();
    let wall_s = ends.iter().copied().flatten().map(|end| end.wall_s).sum();
    let attributes = [("name", outcome.study.clone())]
        .into_iter()
        .chain(totals(&ends, wall_s));
    inside(xml, "testsuite", attributes, |xml| {
        inside(xml, "properties", [], |xml| {
            property(xml, "exit_code", &exit_code.to_string())?;
            property(xml, "program", concat!("regimen ", env!("CARGO_PKG_VERSION")))?;
            outcome
                .counts()
                .iter()
                .try_for_each(|(word, count)| property(xml, word, &count.to_string()))
        })?;
        outcome
            .trials
            .iter()
            .try_for_each(|(trial, end)| case(xml, &outcome.study, trial, end.as_ref()))
    })
}

/// Numbers of tests, failures, errors and skipped ones, and the time, as attributes.
fn totals(ends: &[&Option<TrialEnd>], wall_s: f64) -> [(&'static str, String); 5] {
    let count = |kind: &str| {
        ends.iter()
            .filter(|end| element(end.as_ref()) == Some(kind))
            .count()
            .to_string()
    };
    [
        ("tests", ends.len().to_string()),
        ("failures", count("failure")),
        ("errors", count("error")),
        ("skipped", count("skipped")),
        ("time", format!("{wall_s:.3}")),
    ]
}

fn case(xml: &mut Xml, study: &str, trial: &Trial, end: Option<&TrialEnd>) -> io::Result<()> {
    let seed = format!("seed {}", trial.key.seed);
    let words = [trial.cell.agent.as_str(), &trial.cell.setting, &seed];
    let name = words
        .into_iter()
        .filter(|word| !word.is_empty())
        .collect::<Vec<_>>()
        .join("/");
    let wall_s = end.map_or(0.0, |end| end.wall_s);
    let class = format!("{study}.{}", trial.cell.environment);
    inside(
        xml,
        "testcase",
        [
            ("classname", class),
            ("name", name),
            ("time", format!("{wall_s:.3}")),
        ],
        |xml| {
            inside(xml, "properties", [], |xml| property(xml, "id", &trial.id))?;
            let Some(element) = element(end) else {
                return Ok(());
            };
            let Some(end) = end else {
                return empty(xml, element, [("message", "has not run".to_owned())]);
            };
            let attributes = [
                ("message", end.reason.clone()),
                ("type", end.state.name().to_owned()),
            ];
            inside(xml, element, attributes, |xml| {
                xml.write_event(Event::Text(BytesText::new(&printable(&end.reason))))
            })
        },
    )
}

/// The element that says what was wrong; none for a trial that ended well.
fn element(end: Option<&TrialEnd>) -> Option<&'static str> {
    match end.map(|end| end.state) {
        Some(EndState::Ok) => None,
        Some(EndState::Failed | EndState::Nan) => Some("failure"),
        Some(EndState::Panicked | EndState::Timeout | EndState::Oom | EndState::Killed) => Some("error"),
        None | Some(EndState::Paused) => Some("skipped"),
    }
}

fn property(xml: &mut Xml, name: &str, value: &str) -> io::Result<()> {
    empty(
        xml,
        "property",
        [("name", name.to_owned()), ("value", value.to_owned())],
    )
}

fn empty(
    xml: &mut Xml,
    name: &str,
    attributes: impl IntoIterator<Item = (&'static str, String)>,
) -> io::Result<()> {
    xml.write_event(Event::Empty(start(name, attributes)))
}

fn inside(
    xml: &mut Xml,
    name: &str,
    attributes: impl IntoIterator<Item = (&'static str, String)>,
    content: impl FnOnce(&mut Xml) -> io::Result<()>,
) -> io::Result<()> {
    xml.write_event(Event::Start(start(name, attributes)))?;
    content(xml)?;
    xml.write_event(Event::End(BytesEnd::new(name)))
}

fn start(name: &str, attributes: impl IntoIterator<Item = (&'static str, String)>) -> BytesStart<'_> {
    let mut tag = BytesStart::new(name);
    for (key, value) in attributes {
        tag.push_attribute((key, printable(&value).as_str()));
    }
    tag
}

/// Without the characters that XML cannot hold even when escaped.
fn printable(text: &str) -> String {
    let wrong = |it: char| it.is_control() || matches!(it, '\u{fffe}' | '\u{ffff}');
    text.chars()
        .map(|it| if wrong(it) { '\u{fffd}' } else { it })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::{super::outcome::tests::one_of_each, *};
    use quick_xml::Reader;

    #[test]
    fn the_document() {
        insta::assert_snapshot!("junit", junit(&[one_of_each()], 12.5, 106).unwrap());
    }

    /// Attribute values and texts as a reader understands them, by element.
    fn read_back(text: &str) -> Vec<(String, Vec<String>)> {
        let mut reader = Reader::from_str(text);
        let (mut found, mut open) = (Vec::new(), 0);
        loop {
            match reader.read_event().unwrap() {
                Event::Eof => break,
                Event::Start(tag) => {
                    open += 1;
                    found.push(attributes(&tag));
                }
                Event::Empty(tag) => found.push(attributes(&tag)),
                Event::End(_) => open -= 1,
                _ => {}
            }
        }
        assert_eq!(open, 0, "every element is closed");
        found
    }

    fn attributes(tag: &BytesStart<'_>) -> (String, Vec<String>) {
        let value = |text: &str| quick_xml::escape::unescape(text).unwrap().into_owned();
        let values = tag
            .attributes()
            .map(|attribute| value(&attribute.unwrap().value))
            .collect();
        (tag.name().as_ref().to_owned(), values)
    }

    #[test]
    fn what_is_written_can_be_read_back() {
        let outcome = one_of_each();
        let read = read_back(&junit(&[outcome.clone(), outcome.clone()], 12.5, 106).unwrap());
        let count = |name: &str| read.iter().filter(|(element, _)| element == name).count();
        assert_eq!(
            (count("testsuites"), count("testsuite"), count("testcase")),
            (1, 2, 16)
        );
        assert_eq!((count("failure"), count("error"), count("skipped")), (4, 8, 2));
        assert_eq!(read[0].1, ["regimen", "16", "4", "8", "2", "12.500"]);
        assert_eq!(read[1].1[0], "small & <odd>");
        let second = read
            .iter()
            .filter(|(element, _)| element == "testcase")
            .nth(1)
            .unwrap();
        assert_eq!(
            second.1,
            [
                "small & <odd>.four",
                "equal/rate=0.1 note=\"<&>\"/seed 1",
                "1.500"
            ]
        );
        let failure = read.iter().find(|(element, _)| element == "failure").unwrap();
        assert_eq!(
            failure.1,
            ["5 < 3 & \"so on\" \u{fffd}[31m]]>\u{fffd}\u{fffd}", "failed"]
        );
    }
}
