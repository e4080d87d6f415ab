//! Tables in JSON: a line for every record, or one document in a form that pandas, Sacred or TensorBoard writes.

use super::{
    content::Content,
    table::{LogLine, LogTable},
};
use contract::Error;
use csv::StringRecord;
use serde_json::{Map, Value};
use std::{borrow::Cow, collections::BTreeMap};

const FORMS: &str = "JSON is read as an object on every line, a list of objects, an object of lists, and as metrics.json and \
                     info.json of Sacred: convert it with pandas.DataFrame(...).to_csv(\"log.csv\")";

/// The key of a line that is not a record. The program resumes from a checkpoint here, and values that it logs from now
/// on replace earlier ones at the same and later steps.
pub const BEGINS_AGAIN: &str = "regimen_begins_again";

/// The table that a file holds.
pub(super) fn table(file: &Content) -> Result<LogTable, Error> {
    let text = with_numbers_quoted(file.text()?);
    let mut values = serde_json::Deserializer::from_str(&text).into_iter::<Value>();
    let (mut rows, mut documents) = (Rows::default(), Vec::new());
    let (mut line, mut at) = (1, 0);
    loop {
        let start = at + text[at..].len() - text[at..].trim_start().len();
        line += text[at..start].matches('\n').count() as u64;
        at = start;
        let value = match values.next() {
            None => break,
            Some(Ok(value)) => value,
            Some(Err(error)) if error.is_eof() && rows.lines.len() > 1 => {
                let name = file.name();
                rows.notes.push(format!(
                    "line {line} of `{name}` was not written to its end and is left out"
                ));
                break;
            }
            Some(Err(error)) => {
                return Err(file.wrong(Some(error.line() as u64), format!("it is no JSON: {error}")));
            }
        };
        match value {
            Value::Object(object) if object.contains_key(BEGINS_AGAIN) => rows.begins_again = true,
            Value::Object(object) => {
                if documents.is_empty() && rows.lines.is_empty() {
                    documents.push(object.clone());
                }
                rows.push(line, &object);
            }
            Value::Array(items) if rows.lines.is_empty() => {
                return of_list(file, &items).map(|it| it.table(file));
            }
            _ => return Err(file.wrong(Some(line), format!("no object stands here: {FORMS}"))),
        }
        let end = values.byte_offset();
        line += text[at..end].matches('\n').count() as u64;
        at = end;
    }
    let rows = match documents.pop() {
        Some(document)
            if rows.lines.len() == 1 && document.values().any(|it| it.is_array() || it.is_object()) =>
        {
            of_document(file, document)?.unwrap_or(rows)
        }
        _ => rows,
    };
    Ok(rows.table(file))
}

/// The values of an object on a line, by names joined as in tables; `None` where the line holds no object.
#[must_use]
pub fn of_line(line: &str) -> Option<Vec<(String, String)>> {
    let Ok(Value::Object(object)) = serde_json::from_str(&with_numbers_quoted(line)) else {
        return None;
    };
    let mut rows = Rows::default();
    rows.push(1, &object);
    let cells = rows
        .lines
        .iter()
        .flat_map(|line| line.cells.iter().map(str::to_owned));
    Some(rows.names.iter().cloned().zip(cells).collect())
}

/// Lines collected so far, with the union of their names.
#[derive(Default)]
struct Rows {
    names: Vec<String>,
    places: BTreeMap<String, usize>,
    lines: Vec<LogLine>,
    notes: Vec<String>,
    /// Whether the next line is the first one after a restart.
    begins_again: bool,
}

impl Rows {
    fn place(&mut self, name: &str) -> usize {
        if let Some(place) = self.places.get(name) {
            return *place;
        }
        self.names.push(name.to_owned());
        self.places.insert(name.to_owned(), self.names.len() - 1);
        self.names.len() - 1
    }

    fn push(&mut self, number: u64, object: &Map<String, Value>) {
        let mut cells: Vec<(usize, String)> = Vec::new();
        self.flatten("", object, &mut cells);
        self.line(number, cells);
    }

    fn line(&mut self, number: u64, cells: Vec<(usize, String)>) {
        let width = cells.iter().map(|(place, _)| place + 1).max().unwrap_or(0);
        let mut all = vec![String::new(); width];
        for (place, text) in cells {
            all[place] = text;
        }
        let cells = StringRecord::from(all);
        self.lines.push(LogLine {
            number,
            begins_again: std::mem::take(&mut self.begins_again),
            cells,
        });
    }

    /// Names of nested objects are joined by `/`, as in loggers that write both JSON and CSV.
    fn flatten(&mut self, before: &str, object: &Map<String, Value>, cells: &mut Vec<(usize, String)>) {
        for (key, value) in object {
            let name = if before.is_empty() {
                key.clone()
            } else {
                format!("{before}/{key}")
            };
            match (scalar(value), value) {
                (Some(text), _) => cells.push((self.place(&name), text)),
                (None, Value::Object(inner)) => self.flatten(&name, inner, cells),
                (None, _) => cells.push((self.place(&name), "[…]".into())),
            }
        }
    }

    fn table(self, file: &Content) -> LogTable {
        LogTable {
            path: file.path.clone(),
            names: self.names,
            lines: self.lines,
            notes: self.notes,
            ..LogTable::default()
        }
    }
}

/// A value as the text of a cell. Numbers of NumPy are objects, as `jsonpickle` writes them.
fn scalar(value: &Value) -> Option<String> {
    match value {
        Value::Null => Some(String::new()),
        Value::Bool(truth) => Some(truth.to_string()),
        Value::Number(number) => Some(number.to_string()),
        Value::String(text) => Some(text.clone()),
        Value::Object(object) if object.contains_key("py/object") => object.get("value").and_then(scalar),
        _ => None,
    }
}

/// A list of objects, or of lists of three numbers as TensorBoard's JSON download contains them.
fn of_list(file: &Content, items: &[Value]) -> Result<Rows, Error> {
    let mut rows = Rows::default();
    for (item, number) in items.iter().zip(1..) {
        match item {
            Value::Object(object) => rows.push(number, object),
            Value::Array(cells) if cells.len() == 3 => {
                let names = ["Wall time", "Step", "Value"];
                let cells = names
                    .iter()
                    .zip(cells)
                    .filter_map(|(name, cell)| Some((rows.place(name), scalar(cell)?)));
                let cells = cells.collect();
                rows.line(number, cells);
            }
            _ => return Err(file.wrong(None, format!("item {number} of its list is no object: {FORMS}"))),
        }
    }
    Ok(rows)
}

/// A document of columns; `None` where it is a single record.
fn of_document(file: &Content, document: Map<String, Value>) -> Result<Option<Rows>, Error> {
    let lists = |value: &Value| value.is_array();
    let curve =
        |value: &Value| value.get("steps").is_some_and(lists) && value.get("values").is_some_and(lists);
    let by_index = |value: &Value| {
        value
            .as_object()
            .is_some_and(|it| !it.is_empty() && it.keys().all(|key| key.parse::<u64>().is_ok()))
    };
    if let (Some(Value::Array(names)), Some(Value::Array(data))) =
        (document.get("columns"), document.get("data"))
    {
        return split(file, names, data).map(Some);
    }
    if document.values().all(curve) {
        return curves(file, &document).map(Some);
    }
    if document.values().all(by_index) {
        return Ok(Some(indexed(&document)));
    }
    if !document.values().all(lists) {
        let record = document.values().all(|value| !lists(value));
        let problem = format!("lists and other values stand beside each other: {FORMS}");
        return if record {
            Ok(None)
        } else {
            Err(file.wrong(None, problem))
        };
    }
    let timed = document
        .keys()
        .any(|key| document.contains_key(&format!("{key}_T")));
    if timed {
        with_steps(file, &document)
    } else {
        lists_of(file, &document)
    }
    .map(Some)
}

fn items(value: Option<&Value>) -> &[Value] {
    value.and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

fn cell(rows: &mut Rows, name: &str, value: &Value) -> (usize, String) {
    (rows.place(name), scalar(value).unwrap_or_else(|| "[…]".into()))
}

/// The form that pandas writes with `orient="split"`.
fn split(file: &Content, names: &[Value], data: &[Value]) -> Result<Rows, Error> {
    let mut rows = Rows::default();
    let names: Vec<String> = names
        .iter()
        .map(|name| scalar(name).unwrap_or_default())
        .collect();
    for (row, number) in data.iter().zip(1..) {
        let values = items(Some(row));
        if values.len() != names.len() {
            let problem = format!(
                "row {number} of `data` has {} values, and there are {} columns",
                values.len(),
                names.len()
            );
            return Err(file.wrong(None, problem));
        }
        let cells = names
            .iter()
            .zip(values)
            .map(|(name, value)| cell(&mut rows, name, value))
            .collect();
        rows.line(number, cells);
    }
    Ok(rows)
}

/// The form of Sacred's `metrics.json`: every metric has its own steps, which become the column `step`.
fn curves(file: &Content, document: &Map<String, Value>) -> Result<Rows, Error> {
    let mut rows = Rows::default();
    for (name, curve) in document {
        let (steps, values) = (items(curve.get("steps")), items(curve.get("values")));
        points(file, &mut rows, (name, values), ("step", steps))?;
    }
    Ok(rows)
}

/// The form of Sacred's `info.json`: the steps of `return_mean` have the key `return_mean_T`. They become columns under
/// that name and under `step`.
fn with_steps(file: &Content, document: &Map<String, Value>) -> Result<Rows, Error> {
    let mut rows = Rows::default();
    for (name, values) in document {
        let of = format!("{name}_T");
        if let Some(steps) = document.get(&of) {
            points(
                file,
                &mut rows,
                (name, items(Some(values))),
                (&of, items(Some(steps))),
            )?;
        }
    }
    Ok(rows)
}

fn points(
    file: &Content,
    rows: &mut Rows,
    (name, values): (&str, &[Value]),
    (of, steps): (&str, &[Value]),
) -> Result<(), Error> {
    if steps.len() != values.len() {
        let problem = format!("`{name}` has {} values and {} steps", values.len(), steps.len());
        return Err(file.wrong(None, problem));
    }
    for ((step, value), number) in steps.iter().zip(values).zip(1..) {
        let mut cells = vec![cell(rows, "step", step), cell(rows, name, value)];
        if of != "step" {
            cells.push(cell(rows, of, step));
        }
        rows.line(number, cells);
    }
    Ok(())
}

/// The form that pandas writes without an `orient`: cells by the index of their row.
fn indexed(document: &Map<String, Value>) -> Rows {
    let mut rows = Rows::default();
    let mut lines: BTreeMap<u64, Vec<(usize, String)>> = BTreeMap::new();
    for (name, column) in document {
        for (index, value) in column.as_object().into_iter().flatten() {
            let cell = cell(&mut rows, name, value);
            lines.entry(index.parse().unwrap_or(0)).or_default().push(cell);
        }
    }
    for (index, cells) in lines {
        rows.line(index + 1, cells);
    }
    rows
}

/// An object of lists of one length.
fn lists_of(file: &Content, document: &Map<String, Value>) -> Result<Rows, Error> {
    let mut lengths = document
        .iter()
        .map(|(name, list)| (name, items(Some(list)).len()));
    let (one, length) = lengths.next().unzip();
    let length = length.unwrap_or(0);
    if let (Some(one), Some((other, unlike))) = (one, lengths.find(|(_, other)| *other != length)) {
        let problem =
            format!("`{one}` has {length} values and `{other}` {unlike}, so that they are no table");
        return Err(file.wrong(None, problem));
    }
    let mut rows = Rows::default();
    for row in 0..length {
        let cells = document
            .iter()
            .map(|(name, list)| cell(&mut rows, name, &items(Some(list))[row]))
            .collect();
        rows.line(row as u64 + 1, cells);
    }
    Ok(rows)
}

/// `NaN` and `Infinity`, which Python writes and JSON lacks, as texts.
fn with_numbers_quoted(text: &str) -> Cow<'_, str> {
    if !text.contains("NaN") && !text.contains("Infinity") {
        return Cow::Borrowed(text);
    }
    let (mut whole, mut rest, mut is_text) = (String::with_capacity(text.len() + 64), text, false);
    while let Some(letter) = rest.chars().next() {
        let word = ["NaN", "Infinity", "-Infinity"]
            .into_iter()
            .find(|word| !is_text && rest.starts_with(word));
        let taken = match (word, letter) {
            (Some(word), _) => {
                whole.extend(["\"", word, "\""]);
                word.len()
            }
            (None, '\\') if is_text => {
                let escaped = 1 + rest[1..].chars().next().map_or(0, char::len_utf8);
                whole.push_str(&rest[..escaped]);
                escaped
            }
            (None, _) => {
                is_text ^= letter == '"';
                whole.push(letter);
                letter.len_utf8()
            }
        };
        rest = &rest[taken..];
    }
    Cow::Owned(whole)
}

#[cfg(test)]
mod tests {
    use super::{super::content::content, *};

    fn read(text: &str) -> LogTable {
        table(&content("a.json", text)).unwrap()
    }

    /// The names, and the lines below them as text.
    fn shown(table: &LogTable) -> Vec<String> {
        let line = |line: &LogLine| line.cells.iter().collect::<Vec<_>>().join(",");
        std::iter::once(table.names.join(","))
            .chain(table.lines.iter().map(line))
            .collect()
    }

    #[test]
    fn every_line_is_a_record_and_nested_names_are_joined() {
        let table = read(
            "{\"step\": 0, \"eval\": {\"return\": 1.5}}\n\n{\"step\": 10, \"loss\": NaN, \"who\": \"NaN \\\" x\"}\n",
        );
        assert_eq!(
            shown(&table),
            ["eval/return,step,loss,who", "1.5,0", ",10,NaN,NaN \" x"]
        );
        assert_eq!(table.lines.iter().map(|it| it.number).collect::<Vec<_>>(), [1, 3]);
        assert_eq!(
            shown(&read("{\"step\": 3, \"x\": -Infinity}")),
            ["step,x", "3,-Infinity"]
        );
    }

    #[test]
    fn documents_of_other_programs_are_tables() {
        for (text, wanted) in [
            (
                "[{\"step\": 0, \"x\": 1}, {\"step\": 5, \"x\": null}]",
                vec!["step,x", "0,1", "5,"],
            ),
            (
                "{\"step\": [0, 5], \"x\": [1, 2.5]}",
                vec!["step,x", "0,1", "5,2.5"],
            ),
            (
                "{\"step\": {\"0\": 0, \"10\": 9, \"2\": 5}, \"x\": {\"0\": 1, \"2\": 2, \"10\": 3}}",
                vec!["step,x", "0,1", "5,2", "9,3"],
            ),
            (
                "{\"columns\": [\"step\", \"x\"], \"index\": [0], \"data\": [[0, 1]]}",
                vec!["step,x", "0,1"],
            ),
            (
                "[[1700.5, 10, 0.25], [1701.5, 20, 0.5]]",
                vec!["Wall time,Step,Value", "1700.5,10,0.25", "1701.5,20,0.5"],
            ),
            (
                "{\"r\": {\"steps\": [1, 2], \"values\": [3, 4], \"timestamps\": []}}",
                vec!["step,r", "1,3", "2,4"],
            ),
            (
                "{\"r\": [1, {\"py/object\": \"numpy.float64\", \"value\": 2.5}], \"r_T\": [100, 200]}",
                vec!["step,r,r_T", "100,1,100", "200,2.5,200"],
            ),
        ] {
            assert_eq!(shown(&read(text)), wanted, "{text}");
        }
    }

    #[test]
    fn a_last_line_without_an_end_is_left_out_and_others_are_refused() {
        let torn = read("{\"step\": 0}\n{\"step\": 5}\n{\"st");
        assert_eq!((torn.lines.len(), torn.notes.len()), (2, 1));
        for (text, part) in [
            ("{\"step\": 0}\n{\"step\" 5}\n{}", "line 2: it is no JSON"),
            ("{\"step\": 0}\n5\n", "line 2: no object stands here"),
            ("{\"a\": [1], \"b\": [1, 2]}", "`a` has 1 values and `b` 2"),
            ("{\"a\": [1], \"b\": 2}", "lists and other values"),
            ("[1, 2]", "item 1 of its list is no object"),
            ("{\"a\": [1, 2], \"a_T\": [1]}", "`a` has 2 values and 1 steps"),
        ] {
            let told = table(&content("a.json", text)).unwrap_err().to_string();
            assert!(told.contains(part), "{told}");
        }
    }
}
