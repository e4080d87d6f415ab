//! Claims against what trials record.

use super::{Names, Picked, typed};
use crate::{
    diagnostic::{Span, suggest},
    document::Node,
    spec::claims::{self, ClaimSpec},
};

impl Names<'_> {
    /// Checks every name in a claim.
    pub(super) fn claim(&mut self, item: &Node, at: &str) -> Option<ClaimSpec> {
        let (spec, text) = match item.as_str() {
            Some(text) => (ClaimSpec { claim: text.into(), ..ClaimSpec::default() }, item),
            None => (typed::<ClaimSpec>(item)?, item.get("claim")?),
        };
        let environment = match item.get("environment") {
            Some(node) => Some(self.known(node, "environment", &self.world.environments, &format!("{at}.environment"))?),
            None => None,
        };
        // The text may begin with a quotation mark, which is part of the span but not of the claim.
        let quote = usize::from(text.span.length > spec.claim.chars().count());
        let word = |position: usize, length: usize| Span { column: text.span.column + quote + position, length, ..text.span };
        match claims::operands(&spec.claim) {
            Err(mistake) => {
                let length = mistake.length(&spec.claim);
                let example = "a claim reads `AGENT.METRIC > AGENT.METRIC`, with `>`, `<`, `>=` or `<=` and numbers where needed";
                self.say((word(mistake.position, length), at.into()), mistake.message, example);
            }
            Ok(operands) => {
                for operand in operands {
                    let (agent, metric) = (operand.agent.chars().count(), operand.metric.chars().count());
                    let spans = [word(operand.position, agent), word(operand.position + agent + 1, metric)];
                    self.operand(&operand, environment, spans.map(|span| (span, at.to_string())));
                }
            }
        }
        Some(spec)
    }

    fn operand(&mut self, operand: &claims::Operand, environment: Option<usize>, [agent_at, metric_at]: [(Span, String); 2]) {
        let Some(agent) = self.world.agents.iter().position(|known| *known == operand.agent) else {
            let help = suggest(&operand.agent, self.world.agents.iter().map(String::as_str));
            return self.say(agent_at, format!("no agent is named `{}`", operand.agent), help);
        };
        let environments = environment.map_or_else(|| (0..self.world.environments.len()).collect(), |index| vec![index]);
        let recorded = self.recorded(&Picked { agents: vec![agent], environments });
        if recorded.is_empty() {
            self.say(agent_at, format!("no trial feeds the agent `{}` here", operand.agent), "`exclude` leaves it out");
        } else if !recorded.contains(&operand.metric) {
            self.unknown_metric(&operand.metric, metric_at, &recorded);
        }
    }
}
