//! Letters that look like others, or are invisible. They come with a text from a web page, a PDF file or a word
//! processor, and no reader sees the mistake.

/// A letter that looks like another one, or is invisible.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Lookalike {
    /// The letter in the text.
    pub letter: char,
    /// Name of the letter, with the article.
    pub name: String,
    /// The letter to write instead; `None` if it must be removed.
    pub instead: Option<char>,
    /// Place in the text, in characters from 0.
    pub index: usize,
}

impl Lookalike {
    /// Name of the letter and the advice, as a clause.
    #[must_use]
    pub fn sentence(&self) -> String {
        format!("{} stands here: {}", self.named(), self.advice())
    }

    /// Name of the letter with its code point.
    #[must_use]
    pub fn named(&self) -> String {
        format!("{} (U+{:04X})", self.name, u32::from(self.letter))
    }

    /// The advice, as a clause.
    #[must_use]
    pub fn advice(&self) -> String {
        match self.instead {
            Some(' ') => "replace it by a space".into(),
            Some('\n') => "replace it by a line break".into(),
            Some(letter) => format!("write `{letter}` instead"),
            None => "remove it".into(),
        }
    }

    /// Whether the letter looks like a space, or is invisible.
    #[must_use]
    pub fn is_invisible(&self) -> bool {
        matches!(self.instead, None | Some(' ' | '\n'))
    }
}

/// The first lookalike in a text. Letters of other scripts count only if they stand beside letters of the script that
/// they imitate.
#[must_use]
pub fn first(text: &str) -> Option<Lookalike> {
    let mixed = text.chars().any(|letter| letter.is_ascii_alphabetic());
    text.chars()
        .enumerate()
        .find_map(|(index, letter)| of(letter, index).or_else(|| homoglyph(letter, index).filter(|_| mixed)))
}

/// The text with plain letters instead of their lookalikes.
#[must_use]
pub fn straightened(text: &str) -> String {
    let replaced = text.chars().filter_map(|letter| match of(letter, 0) {
        Some(found) => found.instead,
        None => Some(letter),
    });
    replaced.collect()
}

/// The lookalike of a sign, a space or a mark.
pub fn of(letter: char, index: usize) -> Option<Lookalike> {
    let (name, instead): (&str, Option<char>) = match letter {
        '\u{a0}' => ("a non-breaking space", Some(' ')),
        '\u{2007}' => ("a figure space", Some(' ')),
        '\u{2009}' => ("a thin space", Some(' ')),
        '\u{200a}' => ("a hair space", Some(' ')),
        '\u{202f}' => ("a narrow non-breaking space", Some(' ')),
        '\u{3000}' => ("an ideographic space", Some(' ')),
        '\u{1680}' | '\u{2000}'..='\u{2008}' | '\u{205f}' => ("a typographic space", Some(' ')),
        '\u{85}' => ("a next-line character", Some('\n')),
        '\u{2028}' => ("a line separator", Some('\n')),
        '\u{2029}' => ("a paragraph separator", Some('\n')),
        '\u{ad}' => ("a soft hyphen", None),
        '\u{200b}' => ("a zero-width space", None),
        '\u{200c}' => ("a zero-width non-joiner", None),
        '\u{200d}' => ("a zero-width joiner", None),
        '\u{2060}' => ("a word joiner", None),
        '\u{feff}' => ("a byte-order mark", None),
        '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => {
            ("a mark of the direction of writing", None)
        }
        '\u{2010}' => ("a hyphen", Some('-')),
        '\u{2011}' => ("a non-breaking hyphen", Some('-')),
        '\u{2012}' => ("a figure dash", Some('-')),
        '\u{2013}' => ("an en dash", Some('-')),
        '\u{2014}' => ("an em dash", Some('-')),
        '\u{2015}' => ("a horizontal bar", Some('-')),
        '\u{2212}' => ("a minus sign", Some('-')),
        '\u{201c}'..='\u{201f}' => ("a curly quotation mark", Some('"')),
        '\u{2018}'..='\u{201b}' => ("a curly apostrophe", Some('\'')),
        '\u{2032}' => ("a prime", Some('\'')),
        '\u{2033}' => ("a double prime", Some('"')),
        '\u{2236}' | '\u{2d0}' => ("a sign that looks like a colon", Some(':')),
        '\u{3001}' => ("an ideographic comma", Some(',')),
        '\u{2215}' | '\u{2044}' => ("a slash for fractions", Some('/')),
        _ => return full_width(letter, index),
    };
    Some(Lookalike {
        letter,
        name: name.into(),
        instead,
        index,
    })
}

/// The wide forms of the printable letters of ASCII.
fn full_width(letter: char, index: usize) -> Option<Lookalike> {
    let plain = ('\u{ff01}'..='\u{ff5e}')
        .contains(&letter)
        .then(|| u32::from(letter) - 0xfee0);
    let instead = plain.and_then(char::from_u32)?;
    let name = match instead {
        ':' => "a full-width colon".into(),
        ',' => "a full-width comma".into(),
        '-' => "a full-width hyphen".into(),
        '0'..='9' => format!("a full-width digit {instead}"),
        _ => format!("a full-width `{instead}`"),
    };
    Some(Lookalike {
        letter,
        name,
        instead: Some(instead),
        index,
    })
}

/// Letters of Cyrillic and Greek that look like Latin ones, each before the one that it looks like.
const HOMOGLYPHS: &str = "\u{430}a\u{435}e\u{43e}o\u{440}p\u{441}c\u{443}y\u{445}x\u{456}i\u{455}s\u{458}j\u{501}d\u{4bb}h\
    \u{410}A\u{412}B\u{415}E\u{41a}K\u{41c}M\u{41d}H\u{41e}O\u{420}P\u{421}C\u{422}T\u{425}X\u{406}I\u{405}S\u{408}J\
    \u{391}A\u{392}B\u{395}E\u{396}Z\u{397}H\u{399}I\u{39a}K\u{39c}M\u{39d}N\u{39f}O\u{3a1}P\u{3a4}T\u{3a5}Y\u{3a7}X\
    \u{3bf}o\u{3bd}v";

fn homoglyph(letter: char, index: usize) -> Option<Lookalike> {
    let mut pairs = HOMOGLYPHS.chars();
    while let (Some(other), Some(latin)) = (pairs.next(), pairs.next()) {
        if other == letter {
            let script = if ('\u{370}'..'\u{400}').contains(&letter) {
                "Greek"
            } else {
                "Cyrillic"
            };
            return Some(Lookalike {
                letter,
                name: format!("a {script} letter"),
                instead: Some(latin),
                index,
            });
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(text: &str) -> Option<String> {
        first(text).map(|it| format!("{}: {}", it.index, it.sentence()))
    }

    #[test]
    fn a_letter_is_named_with_its_code_point_and_what_to_write() {
        let expected = [
            (
                "1e\u{2013}3",
                "2: an en dash (U+2013) stands here: write `-` instead",
            ),
            (
                "\u{a0}a",
                "0: a non-breaking space (U+00A0) stands here: replace it by a space",
            ),
            (
                "ag\u{200b}ents",
                "2: a zero-width space (U+200B) stands here: remove it",
            ),
            (
                "a\u{2028}b",
                "1: a line separator (U+2028) stands here: replace it by a line break",
            ),
            (
                "steps\u{ff1a}2",
                "5: a full-width colon (U+FF1A) stands here: write `:` instead",
            ),
            (
                "\u{ff15}",
                "0: a full-width digit 5 (U+FF15) stands here: write `5` instead",
            ),
            (
                "\u{201c}a\u{201d}",
                "0: a curly quotation mark (U+201C) stands here: write `\"` instead",
            ),
            (
                "\u{430}gents",
                "0: a Cyrillic letter (U+0430) stands here: write `a` instead",
            ),
        ];
        for (text, sentence) in expected {
            assert_eq!(said(text).as_deref(), Some(sentence));
        }
    }

    #[test]
    fn texts_of_other_scripts_are_what_they_look_like() {
        for text in ["größe", "агент", "πράκτορας", "回報", "a-b: 'c', \"d\" 1.5e-3"] {
            assert_eq!(said(text), None, "{text}");
        }
    }

    #[test]
    fn a_text_is_straightened() {
        assert_eq!(straightened("\u{2212}1\u{202f}000\u{ff0c}5\u{200b}"), "-1 000,5");
    }

    #[test]
    fn homoglyphs_stand_in_pairs() {
        let letters: Vec<char> = HOMOGLYPHS.chars().collect();
        assert!(
            letters
                .chunks(2)
                .all(|pair| !pair[0].is_ascii() && pair[1].is_ascii_alphabetic())
        );
    }
}
