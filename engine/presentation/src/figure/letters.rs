//! Letters of the bundled font, and replacements for letters that it lacks.
//!
//! SVG files keep their texts, since a reader of such a file may have another font with these letters. In PNG and PDF
//! files a replacement character stands for each missing letter. Letters that are never drawn are left out.

use super::{
    chart::Chart,
    layout,
    paint::{FONT, Mark},
};
use std::{borrow::Cow, collections::BTreeMap, sync::OnceLock};
use ttf_parser::Face;

/// Replacement for a letter that the font lacks.
const REPLACEMENT: char = '\u{fffd}';
/// Largest number of letters that a sentence names; further ones are only counted.
const MOST_NAMED: usize = 8;

/// Whether the font can draw a letter.
fn has(letter: char) -> bool {
    static FACE: OnceLock<Option<Face<'static>>> = OnceLock::new();
    let face = FACE.get_or_init(|| Face::parse(FONT, 0).ok());
    letter.is_control()
        || face
            .as_ref()
            .is_some_and(|face| face.glyph_index(letter).is_some())
}

/// Whether a letter only controls the drawing of others: joiners, marks of direction, selectors of variants.
fn is_mark_of_layout(letter: char) -> bool {
    matches!(letter,
        '\u{ad}' | '\u{61c}' | '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2060}'..='\u{206f}'
        | '\u{fe00}'..='\u{fe0f}' | '\u{feff}' | '\u{e0000}'..='\u{e0fff}')
}

/// The text in letters that the font can draw.
pub(super) fn drawable(text: &str) -> Cow<'_, str> {
    let stays = |letter: char| has(letter) && !is_mark_of_layout(letter);
    if text.chars().all(stays) {
        return Cow::Borrowed(text);
    }
    let letters = text.chars().filter(|letter| !is_mark_of_layout(*letter));
    letters
        .map(|letter| if has(letter) { letter } else { REPLACEMENT })
        .collect()
}

/// A sentence on the letters of a figure that the font lacks; `None` if it has all.
#[must_use]
pub fn lacking(chart: &Chart) -> Option<String> {
    let mut texts: BTreeMap<String, Vec<char>> = BTreeMap::new();
    for mark in layout::draw(chart).marks {
        let Mark::Text { text, .. } = mark else { continue };
        let lacks = |letter: &char| !has(*letter) && !is_mark_of_layout(*letter);
        let mut letters: Vec<char> = text.chars().filter(lacks).collect();
        letters.sort_unstable();
        letters.dedup();
        if !letters.is_empty() {
            texts.insert(text, letters);
        }
    }
    let mut letters: Vec<char> = texts.values().flatten().copied().collect();
    letters.sort_unstable();
    letters.dedup();
    let named: Vec<String> = letters
        .iter()
        .map(|letter| format!("{letter} (U+{:04X})", u32::from(*letter)))
        .collect();
    let quoted: Vec<String> = texts
        .keys()
        .map(|text| format!("\u{201c}{text}\u{201d}"))
        .collect();
    (!letters.is_empty()).then(|| {
        format!(
            "The font of the PNG and PDF files lacks {}, in {}: {REPLACEMENT} stands for each of them there, and SVG shows \
             them where a reader has a font.",
            first_of(&named),
            first_of(&quoted)
        )
    })
}

/// The first of some words, and the number of the others.
fn first_of(words: &[String]) -> String {
    let more = words.len().saturating_sub(MOST_NAMED);
    let named = words[..words.len() - more].join(", ");
    if more > 0 {
        format!("{named} and {more} more")
    } else {
        named
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::{Panel, Scale};

    #[test]
    fn what_the_font_lacks_is_replaced_and_what_only_says_how_to_draw_is_left_out() {
        assert_eq!(
            drawable("Ĝis возврат α → ∞ −1.5×10⁻³ ∑ ≤ °"),
            "Ĝis возврат α → ∞ −1.5×10⁻³ ∑ ≤ °"
        );
        assert_eq!(drawable("回報 (n = 2)"), "\u{fffd}\u{fffd} (n = 2)");
        assert_eq!(drawable("a\u{200b}b\u{feff}c\u{ad}d"), "abcd");
        assert!(has(REPLACEMENT));
    }

    #[test]
    fn letters_that_the_font_lacks_are_named_with_their_text() {
        let chart = |label: &str| Chart {
            panels: vec![Panel {
                x: Scale {
                    label: label.into(),
                    ..Scale::default()
                },
                ..Panel::default()
            }],
            columns: 1,
            ..Chart::default()
        };
        assert_eq!(lacking(&chart("шаги, βήματα, kroków")), None);
        assert_eq!(
            lacking(&chart("回報")).unwrap(),
            "The font of the PNG and PDF files lacks 回 (U+56DE), 報 (U+5831), in “回報”: \u{fffd} stands for each of them \
             there, and SVG shows them where a reader has a font."
        );
        let all: String = ('\u{4e00}'..='\u{4e20}').collect();
        assert!(lacking(&chart(&all)).unwrap().contains(" and 25 more, in "));
    }
}
