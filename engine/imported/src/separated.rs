//! Text with a separator between columns: commas, tabs, semicolons or bars, whichever splits all lines into the same
//! number of columns.

use super::{
    content::Content,
    table::{Decimals, LogLine, LogTable, commas, has_groups},
};
use contract::Error;
use csv::{ReaderBuilder, StringRecord};

/// Separators, in order of preference. Spaces separate only in files that begin with a comment, as NumPy writes them.
const SEPARATORS: [u8; 5] = [b',', b'\t', b';', b'|', b' '];
/// Number of lines that are examined to find the separator.
const LOOKED_AT: usize = 20;

/// A line with its number.
struct Record {
    number: u64,
    /// Whether a comment stands above it.
    is_below_comment: bool,
    cells: StringRecord,
}

/// The table that a file holds.
pub(super) fn table(file: &Content) -> Result<LogTable, Error> {
    let text = file.text()?;
    // Excel writes the separator into a line of its own.
    let declared = text.lines().next().and_then(|line| line.strip_prefix("sep="));
    let declared = declared.and_then(|sign| SEPARATORS.into_iter().find(|known| sign.as_bytes() == [*known]));
    let separator = declared.unwrap_or_else(|| separator(text));
    let records = records(file, text, separator)?;
    let records = &records[usize::from(declared.is_some())..];
    let mut table = LogTable {
        path: file.path.clone(),
        started: started(text),
        ..LogTable::default()
    };
    let Some((head, names, rest)) = head(text, separator, records) else {
        return Ok(table);
    };
    (table.head, table.names) = (head, names);
    let mut is_below_head = false;
    for record in rest {
        let (number, cells) = (record.number, &record.cells);
        if is_head(cells, &table.names) {
            is_below_head = true;
            continue;
        }
        if cells.len() < table.names.len() && is_torn(text, number) {
            let name = file.name();
            let note = format!("line {number} of `{name}` was not written to its end and is left out");
            table.notes.push(note);
            continue;
        }
        if cells.len() != table.names.len() {
            return Err(file.wrong(Some(number), lengths(cells, &table.names, separator)));
        }
        table.lines.push(LogLine {
            number,
            begins_again: is_below_head || record.is_below_comment && !table.lines.is_empty(),
            cells: cells.clone(),
        });
        is_below_head = false;
    }
    if separator != b',' {
        table.decimals = decimals(&table);
    }
    Ok(table)
}

/// A reader of lines. Only a file that begins with a comment may contain further comments.
fn reader(text: &str, separator: u8) -> csv::Reader<&[u8]> {
    ReaderBuilder::new()
        .delimiter(separator)
        .has_headers(false)
        .flexible(true)
        .comment(text.starts_with('#').then_some(b'#'))
        .from_reader(text.as_bytes())
}

/// All lines but comments and empty ones.
fn records(file: &Content, text: &str, separator: u8) -> Result<Vec<Record>, Error> {
    let mut reader = reader(text, separator);
    let (mut records, mut cells) = (Vec::new(), StringRecord::new());
    let (mut at, mut number) = (0, 1);
    loop {
        let more = reader.read_record(&mut cells);
        if !more.map_err(|error| file.wrong(error.position().map(csv::Position::line), error.to_string()))? {
            return Ok(records);
        }
        // The reader returns the position where it began to look, which may be a comment or an empty line above the
        // record.
        let looked = cells.position().map_or(0, csv::Position::byte);
        let mut begin = usize::try_from(looked).unwrap_or(usize::MAX).min(text.len());
        let mut is_below_comment = false;
        while let Some(line) = text[begin..].split_inclusive('\n').next() {
            let is_comment = text.starts_with('#') && line.starts_with('#');
            if !is_comment && !line.trim_end_matches(['\r', '\n']).is_empty() {
                break;
            }
            is_below_comment |= is_comment;
            begin += line.len();
        }
        number += text[at..begin].matches('\n').count() as u64;
        at = begin;
        let cells = cells.clone();
        records.push(Record {
            number,
            is_below_comment,
            cells,
        });
    }
}

/// The line of the names, the names, and the lines below. If a comment precedes lines of numbers and has as many parts,
/// it holds the names.
fn head<'a>(text: &str, separator: u8, records: &'a [Record]) -> Option<(u64, Vec<String>, &'a [Record])> {
    let (first, rest) = records.split_first()?;
    let trimmed = |name: &str| name.trim().to_owned();
    if text.starts_with('#') && first.cells.iter().all(|cell| cell.trim().parse::<f64>().is_ok()) {
        let comments = text
            .lines()
            .zip(1..)
            .take_while(|(line, _)| line.starts_with('#'));
        let (comment, number) = comments.last()?;
        let names = comment
            .trim_start_matches('#')
            .trim()
            .split(char::from(separator));
        let names: Vec<String> = names.map(trimmed).collect();
        if names.len() == first.cells.len() {
            return Some((number, names, records));
        }
    }
    Some((first.number, first.cells.iter().map(trimmed).collect(), rest))
}

fn is_head(cells: &StringRecord, names: &[String]) -> bool {
    cells.len() == names.len() && cells.iter().zip(names).all(|(cell, name)| cell.trim() == name)
}

/// Whether a line is the last one and has no line end, for example because a program was killed while writing.
fn is_torn(text: &str, number: u64) -> bool {
    let lines = text.lines().count() as u64;
    number == lines && number > 2 && !text.ends_with('\n')
}

fn lengths(cells: &StringRecord, names: &[String], separator: u8) -> String {
    let separator = match separator {
        b'\t' => "tabs".to_owned(),
        other => format!("`{}`", char::from(other)),
    };
    let count = |n: usize| {
        if n == 1 {
            "1 cell".to_owned()
        } else {
            format!("{n} cells")
        }
    };
    let spaces = if names.len() == 1 && names[0].contains(' ') {
        "; where spaces separate the columns, write commas"
    } else {
        ""
    };
    format!(
        "the line has {}, and there {}, between which {separator} stands{spaces}",
        count(cells.len()),
        if names.len() == 1 {
            "is 1 column".to_owned()
        } else {
            format!("are {} columns", names.len())
        },
    )
}

/// The separator that splits the first lines into the most columns, equally many in each; the last line may be
/// incomplete.
fn separator(text: &str) -> u8 {
    let columns = |separator: u8| {
        let records = reader(text, separator).into_records().take(LOOKED_AT);
        let lengths: Vec<usize> = records.map_while(Result::ok).map(|record| record.len()).collect();
        let (first, others) = lengths.split_first()?;
        let unlike = others.iter().filter(|length| *length != first).count();
        let is_table = *first > 1 && (unlike == 0 || unlike == 1 && lengths.last() != Some(first));
        is_table.then_some((*first, separator))
    };
    let head = text
        .lines()
        .find(|line| !line.starts_with('#'))
        .unwrap_or_default();
    let in_head = |separator: &u8| head.bytes().filter(|byte| byte == separator).count();
    // The last of equal maxima is chosen, so the order is reversed to prefer commas.
    let tried = || {
        SEPARATORS
            .into_iter()
            .rev()
            .filter(|it| *it != b' ' || text.starts_with('#'))
    };
    let most = tried().filter_map(columns).max_by_key(|(columns, _)| *columns);
    most.map_or_else(
        || tried().max_by_key(in_head).unwrap_or(b','),
        |(_, separator)| separator,
    )
}

/// The decimal sign of a table with semicolons or tabs between columns: the sign in a number that can be read in only
/// one way.
fn decimals(table: &LogTable) -> Decimals {
    let cells = || {
        table
            .lines
            .iter()
            .flat_map(|line| line.cells.iter())
            .map(str::trim)
    };
    let with_point = |cell: &str| cell.contains('.') && !has_groups(cell) && cell.parse::<f64>().is_ok();
    let by_comma: Vec<bool> = cells().filter_map(commas).collect();
    if by_comma.contains(&true) {
        Decimals::Comma
    } else if by_comma.is_empty() && (cells().any(with_point) || !cells().any(has_groups)) {
        Decimals::Point
    } else {
        Decimals::Unclear
    }
}

/// The time in the comment that a log of the Monitor of Stable-Baselines3 begins with.
fn started(text: &str) -> Option<f64> {
    let comment = text.lines().next()?.strip_prefix('#')?;
    let json: serde_json::Value = serde_json::from_str(comment).ok()?;
    json.get("t_start")?.as_f64()
}

#[cfg(test)]
mod tests {
    use super::{super::content::content, *};

    fn read(text: &str) -> LogTable {
        table(&content("a.csv", text)).unwrap()
    }

    fn numbers(table: &LogTable, column: usize) -> Vec<f64> {
        table
            .lines
            .iter()
            .map(|line| table.number(line, column).unwrap())
            .collect()
    }

    #[test]
    fn the_separator_is_the_one_that_splits_all_lines_alike() {
        for (text, separator) in [
            ("step,return\n0,1\n", b','),
            ("step;return\n0;1,5\n100;2,5\n", b';'),
            ("step\treturn\n0\t1.5\n", b'\t'),
            ("step|return\n0|1.5\n", b'|'),
            ("step,note\n0,\"a;b\"\n1,c\n", b','),
            ("step\n0\n", b','),
            ("step;return\n0;1\n1;2;3\n2;3;4\n", b';'),
            ("#step;return\n0;1\n", b';'),
            ("# step return\n0.0e+00 1.5\n1.0e+02 2.5\n", b' '),
        ] {
            assert_eq!(super::separator(text), separator, "{text}");
        }
    }

    #[test]
    fn comments_and_empty_lines_are_passed_over_and_counted() {
        let table =
            read("#{\"t_start\": 17.5, \"env_id\": \"a\"}\r\nr,l,t\r\n\r\n1,10,0.5\r\n#{}\r\n2,20,0.7\r\n");
        assert_eq!(
            (table.head, &table.names[..]),
            (2, &["r", "l", "t"].map(String::from)[..])
        );
        let lines: Vec<(u64, bool)> = table
            .lines
            .iter()
            .map(|line| (line.number, line.begins_again))
            .collect();
        assert_eq!(lines, [(4, false), (6, true)]);
        assert_eq!(table.started, Some(17.5));
        let numpy = read("# step return\n0.0e+00 1.5\n1.0e+02 2.5\n");
        assert_eq!(
            (numpy.names.join(","), numbers(&numpy, 1)),
            ("step,return".into(), vec![1.5, 2.5])
        );
        let excel = read("sep=;\nstep;return;x\n0;1,5;2\n");
        assert_eq!((excel.head, excel.names.len(), excel.lines[0].number), (2, 3, 3));
        let below = read("# seed 1\n# step, return\n0,1\n5,2\n");
        assert_eq!(
            (below.head, below.names.join(" "), below.lines.len()),
            (2, "step return".into(), 2)
        );
    }

    #[test]
    fn names_that_stand_again_say_that_a_log_was_appended() {
        let table = read("step,x\n0,1\nstep,x\n0,2\n");
        assert_eq!(table.lines.len(), 2);
        assert!(table.lines[1].begins_again && table.lines[1].number == 4);
    }

    #[test]
    fn a_last_line_without_an_end_is_left_out_and_others_are_refused() {
        let torn = read("step,x\n0,1\n5,2\n10");
        assert_eq!((torn.lines.len(), torn.notes.len()), (2, 1));
        for (text, part) in [
            (
                "step,x\n0,1\n5\n10,2\n",
                "line 3: the line has 1 cell, and there are 2 columns, between which `,` stands",
            ),
            ("step,x\n0,1\n5,2\n10,2,3\n", "line 4"),
            ("step x\n0 1,5\n", "write commas"),
        ] {
            let told = table(&content("a.csv", text)).unwrap_err().to_string();
            assert!(told.contains(part), "{told}");
        }
    }

    #[test]
    fn decimal_commas_are_read_where_they_can_be_nothing_else() {
        let table = read("step;return\n0;1,5\n100;-2,125\n");
        assert_eq!(numbers(&table, 1), [1.5, -2.125]);
        let unclear = read("step;return\n0;1,500\n100;2,500\n");
        let told = unclear.number(&unclear.lines[0], 1).unwrap_err().to_string();
        assert!(told.contains("line 2, column `return`: `1,500` may be"), "{told}");
        let groups = read("step;return\n1.000;5\n2.000;6\n");
        let told = groups.whole(&groups.lines[0], 0).unwrap_err().to_string();
        assert!(told.contains("`1.000` may be a number of thousands"), "{told}");
        let points = read("step\treturn\n1.0\t0.100\n");
        assert_eq!(
            (points.whole(&points.lines[0], 0).unwrap(), numbers(&points, 1)),
            (1, vec![0.1])
        );
    }
}
