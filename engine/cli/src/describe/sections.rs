//! The sections of a study, with an example of each form. The schema of a section defines its values. The examples
//! belong to a study with the agents `rule`, `other` and `learner` (only the last one learns), the environments
//! `short`, `long` and `pair`, and the play `tag`. A test checks a study with each of them.

use super::{
    Subject,
    group::Group,
    key::{self, Notation},
};

use analysis::claim::{
    Aggregate,
    forms::{ClaimForm, GRAMMAR, QUANTITIES, RELATIONS},
};
use contract::Registry;
use document::schema_check::View;

/// One use of a section.
pub(super) struct Example {
    pub(super) section: &'static str,
    pub(super) about: &'static str,
    pub(super) text: &'static str,
}

const fn example(section: &'static str, about: &'static str, text: &'static str) -> Example {
    Example { section, about, text }
}

/// At least one example for every section whose entries are no plugins.
pub(super) const EXAMPLES: &[Example] = &[
    example("study", "", "study: first-look"),
    example("include", "sections of another file, seen from this one", "include: common.yaml"),
    example(
        "blocks",
        "keys that several agents share, one of which this one has for itself",
        "blocks:
  cautious: { learning_rate: 0.05, discount: 0.5 }
agents:
  learner: { q_learning: { <<: cautious, discount: 0.9 } }
  rule: { walker: {} }
  other: { walker: { direction: right } }",
    ),
    example("title", "", "title: What a learner gains over a rule"),
    example("source", "", "source: \"Somebody et al. 2024, table 3\""),
    example("family", "studies of one chapter", "family: chapter 3"),
    example(
        "summary",
        "a row of a table and a claim, by their names and numbers",
        "summary: \"The learner ends at {final: learner}; that it beats the rule: {claim 1}.\"
tables:
  final: { comparison: { rows: agent, value: return, environments: [short] } }
claims: [learner.return > rule.return]",
    ),
    example(
        "answers",
        "what the source prints, what was found, and the claim that decides",
        "answers:
  - { item: table 3, printed: the learner beats the rule, here: \"{final: learner}\", by: [claim 1] }
tables:
  final: { comparison: { rows: agent, value: return, environments: [short] } }
claims: [learner.return > rule.return]",
    ),
    example(
        "deviations",
        "",
        "deviations:
  - The source trains ten times as long.",
    ),
    example(
        "confirm",
        "a claim on ten further seeds, and on up to 64 more where half a point matters",
        "claims: [learner.return > rule.return]
confirm:
  - { claims: [1], seeds: 100-109, why: the spread of the first seeds asks for ten }
  - { claims: [1], seeds: { first: 200, min: 16, max: 64, looks: 3 }, min_effect: 0.5 }",
    ),
    example("seeds", "a number of replicates: seeds 0 to 4", "seeds: 5"),
    example("seeds", "the seeds themselves", "seeds: [0, 3, 17]"),
    example(
        "seeds",
        "looks after 5, 10, ... 30 seeds, until all that is judged is decided",
        "seeds: { min: 5, max: 30, looks: 6 }",
    ),
    example(
        "seeds",
        "the numbers of seeds at each look",
        "seeds: { min: 5, max: 30, looks: [5, 10, 30] }",
    ),
    example(
        "success",
        "adds the metric `success`, and `given_success` to claims and tables",
        "success: { metric: return, above: 0.5 }",
    ),
    example(
        "paper_budget",
        "what a learner does not reach in less than half of these steps says nothing against the source",
        "paper_budget: { steps: 600000, agents: [learner] }",
    ),
    example(
        "floors",
        "trained agents are compared with each other where one of them is better than this one",
        "floors: [rule]",
    ),
    example(
        "relevance",
        "a twentieth of the range from the floor to the bound matters",
        "relevance: { floor: rule, bound: other }",
    ),
    example(
        "sweep",
        "every value with every value of the other `grid` keys",
        "sweep:
  learner.discount: { grid: [0.9, 0.99] }
  learner.learning_rate: { grid: [1e-4, 1e-3] }",
    ),
    example(
        "sweep",
        "values that go together, one by one",
        "sweep:
  learner.discount: { zip: [0.9, 0.99] }
  learner.learning_rate: { zip: [1e-4, 1e-3] }",
    ),
    example(
        "sweep",
        "samples: all sampled keys change together, at each sample",
        "sweep:
  learner.discount: { random: { low: 0.9, high: 1, samples: 8 } }
  learner.learning_rate: { log_uniform: { low: 1e-5, high: 1e-2, samples: 8 } }",
    ),
    example(
        "sweep",
        "samples that cover a range evenly",
        "sweep:
  learner.learning_rate: { latin_hypercube: { low: 1e-5, high: 1e-2, samples: 8, log: true } }",
    ),
    example(
        "tune",
        "settings near good ones are tried next; the best one is measured on the seeds of the study",
        "tune:
  rates:
    over:
      learner.discount: { uniform: { low: 0.9, high: 0.999 } }
      learner.learning_rate: { log_uniform: { low: 1e-5, high: 1e-2 } }
    metric: return
    environment: short
    settings: 30
    seeds: 2
    method: { tree_parzen: { startup: 10, batch: 4 } }",
    ),
    example(
        "tune",
        "numbers that depend on each other, from a distribution that takes the shape of the good ones",
        "tune:
  rates:
    over:
      learner.discount: { uniform: { low: 0.9, high: 0.999 } }
      learner.learning_rate: { log_uniform: { low: 1e-5, high: 1e-2 } }
    metric: return
    environment: short
    settings: 60
    method: { cma_es: { population: 6 } }",
    ),
    example(
        "tune",
        "random settings that pause, of which the best third goes on",
        "tune:
  rates:
    over: { learner.learning_rate: { log_uniform: { low: 1e-5, high: 1e-2 } } }
    metric: return
    environment: short
    settings: 27
    method: { halving: { pauses: [100, 300], brackets: 2 } }",
    ),
    example(
        "profiles",
        "budgets, chosen by `-P smoke`; a key is a dotted path",
        "profiles:
  smoke: { protocol.steps: 100, seeds: 1 }
  paper: { protocol.steps: 100000, seeds: 10 }",
    ),
    example(
        "imported",
        "runs of another program, a file each",
        "imported:
  elsewhere:
    from: \"runs/*.csv\"
    environment: short
    step: global_step
    metrics: { return: charts/episodic_return }
    last: 10
    about: \"CleanRL 1.0\"
claims: [learner.return > elsewhere.return in short]",
    ),
    example(
        "imported",
        "runs in several environments, told apart by a column",
        "imported:
  elsewhere:
    - { from: runs/a.csv, environment: short, step: global_step, metrics: { return: charts/episodic_return }, only: { env: 1 } }
    - { from: runs/a.csv, environment: long, step: global_step, metrics: { return: charts/episodic_return }, only: { env: 2 } }",
    ),
    example(
        "exclude",
        "",
        "exclude:
  - { environment: pair, agent: learner }",
    ),
    example(
        "overrides",
        "values for some combinations only",
        "overrides:
  - { environment: long, set: { protocol.steps: 2000 } }",
    ),
    example(
        "prepare",
        "a trial that only leaves something; `{ from: trained }` takes it",
        "prepare:
  trained: { environment: short, agent: learner }",
    ),
    example(
        "cross_play",
        "agents that meet after they were trained",
        "cross_play:
  tag: { environment: pair, roles: { chaser: [walker_0], runner: [walker_1] }, agents: [rule, other] }",
    ),
    example(
        "protocol",
        "",
        "protocol: { train_evaluate: { steps: 1000 } }",
    ),
    example(
        "tables",
        "a published value beside the reproduced one, with how far it may be off",
        "tables:
  final:
    caption: Return after learning
    comparison: { rows: agent, value: return, environments: [short] }
    published: { learner: 0.9 }
    margin: { percent: 5, why: what two implementations differ by }",
    ),
    example(
        "tables",
        "a published value with its scatter, one that is not judged, and a cause",
        "tables:
  final:
    comparison: { rows: agent, value: return, environments: [short] }
    published: { learner: { value: 0.9, sd: 0.1, n: 5 }, rule: { value: 0.4, calibrated_on: the step was chosen by it } }
    cause: { learner: the source trains ten times as long }",
    ),
    example(
        "figures",
        "",
        "figures:
  learning-curve:
    caption: Return during learning
    learning_curve: { metric: return }
    labels: { learner: Q learning }",
    ),
    example("claims", "a claim alone", "claims:\n  - learner.return > rule.return"),
    example(
        "claims",
        "a claim with what is known of it",
        "claims:
  - { claim: learner.return >= 1.15 * rule.return in short, about: the abstract, why: printed there }
  - { claim: auc(learner.return) > rule.return, exploratory: true }
  - { claim: learner.return > rule.return, min_effect: 0.5, why: half a step }",
    ),
    example(
        "limits",
        "",
        "limits: { wall_time_s: 600, memory_mb: 2000, retries: 2 }",
    ),
];

/// Sections with their descriptions, in the order of their names.
pub(super) fn entries(registry: &Registry) -> Vec<(String, String)> {
    let schema = study::json_schema(registry);
    let view = View::new(&schema, &schema);
    let about = |name: &str| {
        view.property(name)
            .map_or_else(String::new, |it| it.sentence() + ".")
    };
    view.property_names()
        .into_iter()
        .map(|name| (name.to_owned(), about(name)))
        .collect()
}

/// A section: its keys, the kinds or plugins that it may contain, and examples.
pub(super) fn subject(registry: &Registry, name: &str) -> Option<Subject> {
    let schema = study::json_schema(registry);
    let view = View::new(&schema, &schema);
    let section = view.property(name)?;
    let required = schema["required"]
        .as_array()
        .is_some_and(|all| all.iter().any(|it| it == name));
    let mut key = key::key(name, &section);
    key.required = required;
    Some(Subject {
        examples: examples(registry, name),
        grammar: if name == "claims" { GRAMMAR } else { "" },
        forms: if name == "claims" {
            claim_forms()
        } else {
            Vec::new()
        },
        choice: choice(registry, name),
        about: std::mem::take(&mut key.about),
        value: Some(key),
        ..Subject::new(name, Group::Sections)
    })
}

/// The names that a section may contain and that are described under their own names.
fn choice(registry: &Registry, section: &str) -> Vec<String> {
    let group = |group: Group| {
        group
            .entries(registry)
            .into_iter()
            .map(|(name, _)| name)
            .collect()
    };
    match section {
        "environments" => group(Group::Environments),
        "agents" => group(Group::Agents),
        "protocol" => group(Group::Protocols),
        "tables" => group(Group::Tables),
        "figures" => group(Group::Figures),
        _ => Vec::new(),
    }
}

fn examples(registry: &Registry, name: &str) -> Vec<Notation> {
    let own = EXAMPLES.iter().filter(|example| example.section == name);
    let mut all: Vec<Notation> = own
        .map(|example| Notation {
            written: example.about.into(),
            example: example.text.into(),
            ..Notation::default()
        })
        .collect();
    if let Some((environment, agent)) = registry.first_study {
        let text = match name {
            "environments" => format!("environments:\n  plant: {{ {environment}: {{}} }}"),
            "agents" => format!("agents:\n  learner: {{ {agent}: {{}} }}"),
            _ => return all,
        };
        all.push(Notation {
            example: text,
            ..Notation::default()
        });
    }
    all
}

fn claim_forms() -> Vec<Notation> {
    let form = |it: &ClaimForm| Notation {
        written: it.written.into(),
        about: it.about.into(),
        example: it.example.into(),
        ..Notation::default()
    };
    let aggregate = |it: Aggregate| Notation {
        written: format!("{}(AGENT.METRIC)", it.name()),
        about: it.about().into(),
        ..Notation::default()
    };
    let quantities = QUANTITIES.iter().map(form);
    let aggregates = Aggregate::ALL.into_iter().map(aggregate);
    quantities
        .chain(aggregates)
        .chain(RELATIONS.iter().map(form))
        .collect()
}

/// The ways to generate the values of a swept key, by name.
pub(super) fn samplers() -> Vec<(String, Notation)> {
    let schema = study::json_schema(&Registry::default());
    let view = View::new(&schema, &schema);
    let generator = view.property("sweep").and_then(|sweep| sweep.property(""));
    let places = generator.map_or_else(Vec::new, |generator| generator.alternatives());
    let named = places.iter().filter_map(|place| {
        let form = key::form(place, 0).into_iter().next()?;
        Some((place.variant()?.to_owned(), form))
    });
    named.collect()
}

/// A sampler with the first example of a sweep that uses it.
pub(super) fn sampler(name: &str, form: Notation) -> Subject {
    let with = |example: &&Example| example.section == "sweep" && example.text.contains(&format!("{name}:"));
    let example = EXAMPLES.iter().find(with).map(|example| Notation {
        written: example.about.into(),
        example: example.text.into(),
        ..Notation::default()
    });
    Subject {
        about: form.about,
        keys: form.keys,
        examples: example.into_iter().collect(),
        ..Subject::new(name, Group::Samplers)
    }
}
