//! Blocks of a document that the program writes; the rest of the document is the author's own text.
//!
//! ```text
//! <!-- overview: answers chapter 2 -->
//! what stood here is replaced
//! <!-- overview: end -->
//! ```

const BEGIN: &str = "<!-- overview: ";
const END: &str = "<!-- overview: end -->";
/// The blocks, for messages.
const KINDS: &str = "`summary`, `families`, `items` or `answers FAMILY`";

/// A block, by the words of its first line.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Block<'a> {
    /// Counts of answers by family.
    Summary,
    /// Counts of verdicts by family.
    Families,
    /// Items of sources with their studies.
    Items,
    /// The answers of a family.
    Answers(&'a str),
}

impl<'a> Block<'a> {
    fn read(words: &'a str) -> Result<Self, String> {
        match words.split_once(' ') {
            None if words == "summary" => Ok(Self::Summary),
            None if words == "families" => Ok(Self::Families),
            None if words == "items" => Ok(Self::Items),
            Some(("answers", family)) => Ok(Self::Answers(family)),
            _ => Err(format!("no block is called `{words}`: write {KINDS}")),
        }
    }
}

/// A document with new text in each block.
///
/// # Errors
/// A block that is unknown, not closed or cannot be made, with its line, and a document without any.
pub(super) fn written(
    document: &str,
    make: &dyn Fn(&Block<'_>) -> Result<String, String>,
) -> Result<String, String> {
    let (mut text, mut open, mut blocks) = (String::new(), None, 0);
    for (index, line) in document.split_inclusive('\n').enumerate() {
        let at = |problem: String| format!("line {}: {problem}", index + 1);
        let words = line.trim_end();
        match (
            open,
            words
                .strip_prefix(BEGIN)
                .and_then(|rest| rest.strip_suffix(" -->")),
        ) {
            (Some(_), Some("end")) => {
                text.push_str(line);
                open = None;
            }
            (Some(first), Some(_)) => {
                return Err(at(format!("the block of line {first} is not closed by `{END}`")));
            }
            (Some(_), None) => {}
            (None, Some("end")) => return Err(at(format!("`{END}` closes nothing"))),
            (None, Some(words)) => {
                let block = Block::read(words).and_then(|block| make(&block)).map_err(at)?;
                text.push_str(&format!("{}\n\n{}\n\n", line.trim_end(), block.trim_end()));
                (open, blocks) = (Some(index + 1), blocks + 1);
            }
            (None, None) => text.push_str(line),
        }
    }
    match open {
        Some(first) => Err(format!("line {first}: the block is not closed by `{END}`")),
        None if blocks == 0 => Err(format!(
            "it has no block: write a line `{BEGIN}... -->` with {KINDS}, and `{END}` after it"
        )),
        None => Ok(text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(document: &str) -> Result<String, String> {
        written(document, &|block| match block {
            Block::Summary => Ok("| summary |".into()),
            Block::Families => Ok("| families |".into()),
            Block::Items => Ok("| items |".into()),
            Block::Answers("chapter 2") => Ok("| answers |\n".into()),
            Block::Answers(other) => Err(format!("no study of the family `{other}`")),
        })
    }

    #[test]
    fn blocks_are_replaced_and_nothing_else() {
        let document = format!(
            "# Title\n\n{BEGIN}families -->\nold\n{END}\n\ntext\n{BEGIN}answers chapter 2 -->\n{END}\nlast"
        );
        let once = made(&document).unwrap();
        let expected = format!(
            "# Title\n\n{BEGIN}families -->\n\n| families |\n\n{END}\n\ntext\n{BEGIN}answers chapter 2 -->\n\n| answers |\n\n\
             {END}\nlast"
        );
        assert_eq!(once, expected);
        assert_eq!(made(&once).unwrap(), once);
    }

    #[test]
    fn what_is_no_block_is_refused_where_it_stands() {
        let wrong = |document: &str| made(document).unwrap_err();
        assert!(wrong("text\n").starts_with("it has no block"));
        assert!(wrong(&format!("a\n{END}\n")).starts_with("line 2: "));
        assert!(wrong(&format!("{BEGIN}items -->\n")).contains("is not closed"));
        assert!(
            wrong(&format!("{BEGIN}items -->\n{BEGIN}families -->\n{END}\n"))
                .starts_with("line 2: the block of line 1")
        );
        assert!(
            wrong(&format!("{BEGIN}table -->\n{END}\n")).starts_with("line 1: no block is called `table`")
        );
        assert!(wrong(&format!("{BEGIN}answers chapter 9 -->\n{END}\n")).contains("`chapter 9`"));
    }
}
