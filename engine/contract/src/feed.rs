//! Things that agents learn from. A protocol gives one of them, and an agent accepts some.

/// Things that an agent learns from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Feed {
    /// Transitions that the agent's own actions led to.
    Decisions,
    /// Observations and states, without actions and rewards.
    Examples,
    /// Transitions that others gathered, in batches, after [`Agent::observe_dataset`](crate::Agent::observe_dataset)
    /// received all of them.
    Dataset,
    /// Whole designs that the agent proposes one after the other, each with its value at its end.
    Designs,
}

impl Feed {
    /// Its name in the description of protocols, in the plural.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Decisions => "decisions",
            Self::Examples => "examples",
            Self::Dataset => "datasets",
            Self::Designs => "designs",
        }
    }

    /// Whether an agent that learns from `taken` learns from this. The steps of a design are decisions too.
    #[must_use]
    pub fn teaches(self, taken: &[Self]) -> bool {
        taken.contains(&self) || (self == Self::Designs && taken.contains(&Self::Decisions))
    }
}

#[cfg(test)]
mod tests {
    use super::Feed;

    #[test]
    fn a_search_teaches_agents_that_learn_from_decisions_and_not_the_other_way() {
        assert!(Feed::Designs.teaches(&[Feed::Decisions]));
        assert!(!Feed::Decisions.teaches(&[Feed::Designs]));
        assert!(Feed::Dataset.teaches(&[Feed::Decisions, Feed::Dataset]));
        assert!(!Feed::Dataset.teaches(&[]));
    }
}
