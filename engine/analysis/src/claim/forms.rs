//! Forms of a claim, each with an example, for the parser and for `describe`.

use super::Relation;

/// A form of a part of a claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClaimForm {
    /// The form as it is written.
    pub written: &'static str,
    /// Meaning of the form.
    pub about: &'static str,
    /// A claim that uses the form.
    pub example: &'static str,
}

/// Relations that are one symbol; longer ones come first, since a shorter one may be their beginning.
pub const SYMBOLS: [(&str, Relation); 5] = [
    (">=", Relation::GreaterOrEqual),
    ("<=", Relation::LessOrEqual),
    (">", Relation::Greater),
    ("<", Relation::Less),
    ("~", Relation::WithinPercent(5.0)),
];

/// The grammar as printed.
pub const GRAMMAR: &str = "\
claim     = quantity relation quantity [ \"in\" ENVIRONMENT ]
          | quantity \"in\" ENVIRONMENT relation quantity \"in\" ENVIRONMENT
quantity  = NUMBER | operand | NUMBER \"*\" operand | operand \"*\" NUMBER
operand   = agent.METRIC | aggregate(agent.METRIC) | PLAY.ROLE.AGENT.METRIC
agent     = AGENT [ \"[\" KEY=VALUE { \",\" KEY=VALUE } \"]\" ]
aggregate = \"final\" | \"auc\" | \"max\" | \"min\" | \"given_success\" | \"rms\"
relation  = \">\" | \">=\" | \"<\" | \"<=\" | \"~\" | \"within\" NUMBER [ \"%\" ] \"of\"";

/// Relations of the two sides.
pub const RELATIONS: [ClaimForm; 7] = [
    ClaimForm {
        written: ">",
        about: "The left side is larger.",
        example: "learner.return > rule.return",
    },
    ClaimForm {
        written: ">=",
        about: "The left side is larger or equal.",
        example: "learner.return >= 1.15 * rule.return",
    },
    ClaimForm {
        written: "<",
        about: "The left side is smaller.",
        example: "rule.return < learner.return",
    },
    ClaimForm {
        written: "<=",
        about: "The left side is smaller or equal.",
        example: "rule.return <= 0.9 * learner.return",
    },
    ClaimForm {
        written: "~",
        about: "The left side lies within 5 % of the right one's mean.",
        example: "rule.return ~ other.return",
    },
    ClaimForm {
        written: "within N % of",
        about: "The left side lies within N percent of the size of the right one's mean.",
        example: "rule.return within 10 % of other.return",
    },
    ClaimForm {
        written: "within N of",
        about: "The left side lies within N of the right one, in the unit of the metric.",
        example: "rule.return within 0.5 of 3",
    },
];

/// Quantities that may stand on either side.
pub const QUANTITIES: [ClaimForm; 8] = [
    ClaimForm {
        written: "AGENT.METRIC",
        about: "The mean of the final measurement, one number per seed; seeds of two agents are paired.",
        example: "learner.return > rule.return",
    },
    ClaimForm {
        written: "AGGREGATE(AGENT.METRIC)",
        about: "Another number of a trial, by one of the aggregates.",
        example: "auc(learner.return) > auc(rule.return)",
    },
    ClaimForm {
        written: "NUMBER * AGENT.METRIC",
        about: "A multiple of a metric; the factor may stand behind it too.",
        example: "learner.return > 1.5 * rule.return",
    },
    ClaimForm {
        written: "NUMBER",
        about: "A number, on one of the sides.",
        example: "learner.return > 0.2",
    },
    ClaimForm {
        written: "AGENT[KEY=VALUE].METRIC",
        about: "The metric of the trials with this value of a swept key; several keys stand with commas between.",
        example: "learner[discount=0.99].return > learner[discount=0.9].return",
    },
    ClaimForm {
        written: "PLAY.ROLE.AGENT.METRIC",
        about: "What an agent reached in a role of a play: the mean over all it met there.",
        example: "tag.chaser.rule.return > tag.chaser.other.return",
    },
    ClaimForm {
        written: "CLAIM in ENVIRONMENT",
        about: "The claim in one environment; without it, in each environment of the study in turn.",
        example: "learner.return > rule.return in short",
    },
    ClaimForm {
        written: "AGENT.METRIC in ENVIRONMENT",
        about: "Where a side was measured, if the other one is of another environment; seeds of the two are paired.",
        example: "learner.return in short > 0.9 * learner.return in long",
    },
];

#[cfg(test)]
mod tests {
    use super::super::{Aggregate, parse};
    use super::*;

    #[test]
    fn every_example_reads_back_and_has_its_form() {
        for form in RELATIONS.iter().chain(&QUANTITIES) {
            let claim = parse(form.example).unwrap_or_else(|error| panic!("{}: {error}", form.example));
            assert_eq!(parse(&claim.to_string()).as_ref(), Ok(&claim));
            assert!(form.about.ends_with('.'), "{}", form.written);
        }
        for form in RELATIONS {
            let symbol = form.written.replace('N', "").replace("  ", " ");
            let first = symbol.split(' ').next().unwrap();
            assert!(form.example.contains(&format!(" {first} ")), "{}", form.example);
        }
    }

    #[test]
    fn every_symbol_and_every_aggregate_is_told() {
        let symbols: Vec<&str> = RELATIONS.iter().map(|form| form.written).collect();
        assert!(SYMBOLS.iter().all(|(symbol, _)| symbols.contains(symbol)));
        assert!(
            SYMBOLS
                .iter()
                .all(|(symbol, _)| GRAMMAR.contains(&format!("\"{symbol}\"")))
        );
        let aggregates = Aggregate::ALL.map(|it| format!("\"{}\"", it.name()));
        assert!(GRAMMAR.contains(&aggregates.join(" | ")), "{aggregates:?}");
    }
}
