//! Verdicts that are read together over several studies, such as those of a chapter: verdicts that still hold with the
//! whole family taken together (Holm), and the number of each word.

use super::{
    passed::Passed,
    sheet::{Sheet, SheetEntry},
    verdicts::Verdicts,
};
use serde::Serialize;
use statistics::{Verdict, holm};
use std::collections::BTreeMap;

const HEAD: [&str; 7] = [
    "family",
    "studies",
    "judged",
    "decided alone",
    "decided together (Holm)",
    "of these against the claim or value",
    "several rounds",
];

/// A family with its counts.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Family {
    /// Name of the family.
    pub family: String,
    /// Number of its studies.
    pub studies: usize,
    /// Number of judged values and claims.
    pub judged: usize,
    /// Number of those that are decided, each on its own.
    pub decided: usize,
    /// Number of those that are decided with all of the family taken together (Holm).
    pub together: usize,
    /// Number of those that differ or are refuted.
    pub against: usize,
    /// Number of judged values and claims that rest on several rounds of seeds.
    pub confirmed: usize,
}

/// Takes the verdicts of each family together. A study without a family is a family of its own, and its report has
/// taken its verdicts together.
pub fn take_together(studies: &mut [Verdicts]) {
    let mut families: BTreeMap<String, Vec<&mut Passed>> = BTreeMap::new();
    for study in studies {
        let Some(family) = &study.family else { continue };
        let judged = study.verdicts.iter_mut().filter(|it| it.is_judged());
        families.entry(family.clone()).or_default().extend(judged);
    }
    for lines in families.values_mut() {
        let strictest: Vec<Option<f64>> = lines.iter().map(|it| it.strictest).collect();
        for (line, is_decided) in lines.iter_mut().zip(holm(&strictest)) {
            let falls = line.is_decided_alone() && !is_decided;
            line.together = falls.then(|| Verdict::Inconclusive.word().to_owned());
        }
    }
}

/// The families in the order of their names, after [`take_together`].
#[must_use]
pub fn families(studies: &[Verdicts]) -> Vec<Family> {
    let mut families: BTreeMap<&str, Family> = BTreeMap::new();
    for study in studies {
        let Some(name) = &study.family else { continue };
        let family = families.entry(name).or_default();
        family.family.clone_from(name);
        family.studies += 1;
        for line in study.verdicts.iter().filter(|it| it.is_judged()) {
            family.judged += 1;
            family.decided += usize::from(line.is_decided_alone());
            family.together += usize::from(line.is_decided());
            family.against += usize::from(line.is_decided() && line.differs());
            family.confirmed += usize::from(line.rounds.len() > 1);
        }
    }
    families.into_values().collect()
}

/// A row for each family; `None` without families.
pub(super) fn sheet(families: &[Family]) -> Option<Sheet> {
    let row = |it: &Family| {
        let counts = [
            it.studies,
            it.judged,
            it.decided,
            it.together,
            it.against,
            it.confirmed,
        ];
        std::iter::once(SheetEntry::plain(it.family.clone()))
            .chain(counts.map(|count| SheetEntry::plain(count.to_string())))
            .collect()
    };
    (!families.is_empty()).then(|| Sheet {
        head: HEAD.map(String::from).to_vec(),
        words: 1,
        rows: families.iter().map(row).collect(),
        ..Sheet::default()
    })
}

/// The families in Markdown; empty without families.
#[must_use]
pub fn families_as_markdown(families: &[Family]) -> String {
    sheet(families).map_or_else(String::new, |sheet| sheet.markdown())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn study(name: &str, family: &str, lines: &[(&str, Option<f64>)]) -> Verdicts {
        let line = |(verdict, strictest): &(&str, Option<f64>)| Passed {
            about: "claim 1: a > b".into(),
            verdict: (*verdict).into(),
            strictest: *strictest,
            ..Passed::default()
        };
        Verdicts {
            study: name.into(),
            family: (!family.is_empty()).then(|| family.into()),
            verdicts: lines.iter().map(line).collect(),
            ..Verdicts::default()
        }
    }

    #[test]
    fn a_family_is_taken_together_over_its_studies() {
        let mut studies = [
            study(
                "one",
                "chapter 1",
                &[("SUPPORTED", Some(0.2)), ("INCONCLUSIVE", None)],
            ),
            study("two", "chapter 1", &[("REFUTED", Some(0.4)), ("NOT RUN", None)]),
            study("three", "chapter 2", &[("DIFFERS", Some(0.9))]),
            study("four", "", &[("SUPPORTED", Some(0.9))]),
        ];
        take_together(&mut studies);
        let words: Vec<&str> = studies
            .iter()
            .flat_map(|it| &it.verdicts)
            .map(Passed::in_all)
            .collect();
        // The first family has three judged verdicts: 0.2 of 1/3 of the level is enough, 0.4 of 1/2 as well.
        assert_eq!(
            words,
            [
                "SUPPORTED",
                "INCONCLUSIVE",
                "REFUTED",
                "NOT RUN",
                "DIFFERS",
                "SUPPORTED"
            ]
        );
        studies[1].verdicts[0].strictest = Some(0.6);
        take_together(&mut studies);
        assert_eq!(studies[1].verdicts[0].in_all(), "INCONCLUSIVE");
        let families = families(&studies);
        assert_eq!(families.len(), 2);
        let first = &families[0];
        assert_eq!(
            (
                first.studies,
                first.judged,
                first.decided,
                first.together,
                first.against
            ),
            (2, 3, 2, 1, 0)
        );
        assert_eq!((families[1].together, families[1].against), (1, 1));
        assert!(families_as_markdown(&families).contains("| chapter 1 | 2 | 3 | 2 | 1 | 0 | 0 |"));
        assert_eq!(families_as_markdown(&[]), "");
    }
}
