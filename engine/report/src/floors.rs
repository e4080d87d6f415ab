//! Check whether trained agents are better than agents that learned nothing.
//!
//! An order among agents that are no better than doing nothing only shows how they fail. A claim that compares two
//! trained agents is therefore judged only if one of them is better than every floor of the study, by the 95 % interval
//! of the difference.

use super::StudyInfo;
use analysis::claim::{Claim, ClaimOutcome, NumberOrigin, Operand, Quantity, Relation, evaluate};
use contract::Better;
use statistics::Seeds;
use std::collections::BTreeSet;

/// Values of an operand by seed, below a limit.
type Values<'a> = &'a dyn Fn(&Operand, u64) -> Option<Vec<(u64, f64)>>;

/// Whether a claim may be judged. It may not if it compares two trained agents and neither is better than all floors.
pub(super) fn are_passed(
    claim: &Claim,
    study: &StudyInfo,
    trained: &BTreeSet<String>,
    values: Values<'_>,
) -> bool {
    let sides = [&claim.left, &claim.right].map(|side| match side {
        Quantity::Measured { operand, .. } if trained.contains(&operand.agent) => Some(operand),
        _ => None,
    });
    let ([Some(left), Some(right)], true) = (sides, claim.relation.is_direction()) else {
        return true;
    };
    let Some(relation) = better(claim, left, study) else {
        return true;
    };
    [left, right]
        .into_iter()
        .any(|side| passes(side, relation, &study.floors, values))
}

/// Sentence on a claim without a trained agent above the floors.
pub(super) fn in_words(floors: &[String]) -> String {
    format!("neither is better than {}", floors.join(" and "))
}

/// The relation of a good agent to a floor. In a play each role has its own interest, so the direction of the claim is
/// used.
fn better(claim: &Claim, operand: &Operand, study: &StudyInfo) -> Option<Relation> {
    let is_claimed_higher = matches!(claim.relation, Relation::Greater | Relation::GreaterOrEqual);
    let is_higher = match operand.within {
        Some(_) => is_claimed_higher,
        None => *study.better.get(&operand.metric)? == Better::Higher,
    };
    Some(if is_higher {
        Relation::Greater
    } else {
        Relation::Less
    })
}

/// Whether an agent is better than each floor that was measured in the same place.
fn passes(agent: &Operand, relation: Relation, floors: &[String], values: Values<'_>) -> bool {
    let side = |operand: Operand| Quantity::Measured { factor: 1.0, operand };
    floors.iter().all(|floor| {
        let of_floor = Operand {
            agent: floor.clone(),
            setting: Vec::new(),
            ..agent.clone()
        };
        if values(&of_floor, u64::MAX).is_none_or(|values| values.is_empty()) {
            return true;
        }
        let claim = Claim {
            left: side(agent.clone()),
            relation,
            right: side(of_floor),
            environment: None,
        };
        let verdict = evaluate(
            &claim,
            None,
            values,
            &|_| NumberOrigin::Measured,
            &Seeds::default(),
        );
        verdict.verdict == ClaimOutcome::Supported
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use analysis::claim::parse;
    use std::collections::BTreeMap;

    fn passed(text: &str, better: Better, of: &[(&str, [f64; 3])]) -> bool {
        let study = StudyInfo {
            floors: vec!["nothing".into(), "random".into()],
            better: BTreeMap::from([("x".to_owned(), better)]),
            ..StudyInfo::default()
        };
        let values = |operand: &Operand, _| {
            let found = of.iter().find(|(agent, _)| *agent == operand.agent)?;
            Some((0..).zip(found.1).collect())
        };
        let trained = ["a", "b"].map(str::to_owned).into();
        are_passed(&parse(text).unwrap(), &study, &trained, &values)
    }

    #[test]
    fn one_of_two_trained_agents_has_to_be_better_than_all_floors() {
        let (low, middle, high) = ([1.0, 1.1, 1.21], [2.0, 2.13, 2.2], [3.0, 3.1, 3.25]);
        let world = |a, b| [("a", a), ("b", b), ("nothing", middle), ("rule", low)];
        let up = |a, b| passed("a.x > b.x", Better::Higher, &world(a, b));
        assert!(up(high, low) && up(low, high) && !up(low, middle) && !up(low, low));
        // Less is better.
        assert!(!passed("a.x < b.x", Better::Lower, &world(high, middle)));
        assert!(passed("a.x < b.x", Better::Lower, &world(low, high)));
        // In a play the direction of the claim is the interest of the role.
        assert!(passed(
            "p.prey.a.x < p.prey.b.x",
            Better::Higher,
            &world(low, high)
        ));
        // A comparison with a rule or a number is judged, and so is a claim that two values are close to each other.
        for claim in ["a.x > rule.x", "a.x > 2", "a.x within 1 of b.x"] {
            assert!(passed(claim, Better::Higher, &world(low, low)), "{claim}");
        }
        // Without a measured floor the claim is judged.
        assert!(passed("a.x > b.x", Better::Higher, &[("a", low), ("b", low)]));
    }
}
