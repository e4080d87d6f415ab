//! Makes a fixed design: the choice of a search, one written out in the study, or a random one with a number.
//!
//! The agent takes the options of the design step by step, independent of observations, and starts over with
//! every episode. A design can thus be measured in an environment where building it costs more than a search
//! could pay.

use crate::shared::designs::{choices, random_design};
use contract::{
    Action, Agent, AgentTraits, Artifact, Choice, Designs, Error, Interface, Mode, Observation, Registry,
    Rng, artifact, choice,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const NAME: &str = "given_design";

/// The design to make.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// The search whose choice is made: an entry whose protocol is `search`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub design: Option<Artifact<artifact::Choice>>,
    /// Rank among the designs that the search chose, 0 for the best one.
    pub rank: usize,
    /// The options by name, step by step, in the order of the choices; instead of `design`. Steps beyond the
    /// last one repeat it.
    pub options: Vec<Vec<String>>,
    /// The number of a random design, whose options are drawn uniformly; instead of the others. The same
    /// number is the same design wherever the choices are the same.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub drawn: Option<u64>,
}

impl contract::Config for Config {}

/// Takes the actions of one design.
#[derive(Debug, Clone)]
pub struct GivenDesign {
    design: DesignSource,
    choices: Vec<Choice>,
    at: usize,
}

/// Actions of the design, or the number that determines them.
#[derive(Debug, Clone)]
enum DesignSource {
    /// One action per step, at least one; the last is repeated.
    Actions(Vec<Vec<f64>>),
    Random(u64),
}

/// Registers the agent.
pub(crate) fn register(registry: &mut Registry, version: u32) {
    let about =
        "makes a given design: one that a search chose, one that is written out, or one that a number names";
    registry.agent(NAME, version, about, AgentTraits::default(), build);
}

/// Builds the agent for one seat that chooses among options.
///
/// # Errors
/// [`Error::Mismatch`] for any other seat; [`Error::Config`] for unknown options or a rank that the search
/// did not leave; and the errors of reading the search's choice.
fn build(config: Config, interface: &Interface, _: &mut Rng) -> Result<Box<dyn Agent>, Error> {
    let choices = choices(NAME, interface)?;
    let design = match (&config.design, config.options.as_slice(), config.drawn) {
        (Some(design), [], None) => DesignSource::Actions(chosen(design, config.rank, &choices)?),
        (None, [], None) => DesignSource::Actions(vec![choice::vector(&choices, &vec![0; choices.len()])]),
        (None, [], Some(number)) => DesignSource::Random(number),
        (None, written, None) => {
            let steps = written.iter().enumerate();
            let actions = steps.map(|(step, options)| written_out(step, options, &choices));
            DesignSource::Actions(actions.collect::<Result<_, Error>>()?)
        }
        _ => {
            let problem = "a design is given twice; leave one of `design`, `options` and `drawn`";
            return Err(Error::config("options", problem));
        }
    };
    Ok(Box::new(GivenDesign {
        design,
        choices,
        at: 0,
    }))
}

/// Action of a random design in a step.
fn drawn(number: u64, step: usize, choices: &[Choice]) -> Vec<f64> {
    let mut rng = contract::random::stream(&["design", &number.to_string(), &step.to_string()]);
    choice::vector(choices, &random_design(choices, &mut rng))
}

fn chosen(
    design: &Artifact<artifact::Choice>,
    rank: usize,
    choices: &[Choice],
) -> Result<Vec<Vec<f64>>, Error> {
    let designs = Designs::read(design.folder()?)?.designs;
    if designs.is_empty() {
        // The artifact of a search before it ran: any design shows whether the choices fit.
        return Ok(vec![choice::vector(choices, &vec![0; choices.len()])]);
    }
    let Some(design) = designs.get(rank) else {
        let problem = format!(
            "the search left {} designs, 0 to {}",
            designs.len(),
            designs.len() - 1
        );
        return Err(Error::config("rank", problem));
    };
    for action in &design.actions {
        choice::taken(choices, action)?;
    }
    Ok(design.actions.clone())
}

fn written_out(step: usize, options: &[String], choices: &[Choice]) -> Result<Vec<f64>, Error> {
    let problem = |problem: String| Error::config(format!("options.{step}"), problem);
    if options.len() != choices.len() {
        let names: Vec<&str> = choices.iter().map(|choice| choice.name.as_str()).collect();
        let found = options.len();
        return Err(problem(format!(
            "{found} options; one is needed for each of: {}",
            names.join(", ")
        )));
    }
    let place = |(option, choice): (&String, &Choice)| {
        choice
            .options
            .iter()
            .position(|known| known == option)
            .ok_or_else(|| {
                let (name, known) = (&choice.name, choice.options.join(", "));
                problem(format!("`{option}` is no option of `{name}`; there are: {known}"))
            })
    };
    let taken: Vec<usize> = options
        .iter()
        .zip(choices)
        .map(place)
        .collect::<Result<_, Error>>()?;
    Ok(choice::vector(choices, &taken))
}

impl Agent for GivenDesign {
    fn act(&mut self, observations: &[Observation], _: Mode, _: &mut Rng) -> Result<Vec<Action>, Error> {
        let action = match &self.design {
            DesignSource::Random(number) => drawn(*number, self.at, &self.choices),
            // There is at least one action, and the last one is repeated.
            DesignSource::Actions(actions) => actions[self.at.min(actions.len() - 1)].clone(),
        };
        self.at += 1;
        Ok(vec![vec![action]; observations.len()])
    }

    fn remembers(&self) -> bool {
        true
    }

    fn restart(&mut self) {
        self.at = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::designs::tests::{interface, scored};
    use contract::{Design, random::stream};

    fn with(options: &[[&str; 2]]) -> Result<Box<dyn Agent>, Error> {
        let options = options
            .iter()
            .map(|step| step.map(str::to_owned).to_vec())
            .collect();
        let config = Config {
            options,
            ..Config::default()
        };
        build(config, &interface(), &mut stream(&[]))
    }

    #[test]
    fn a_written_design_is_made_in_every_episode() {
        let mut agent = with(&[["pre", "batch"], ["pre", "instance"]]).unwrap();
        for _ in 0..2 {
            assert_eq!(scored(&mut *agent, &mut stream(&[])), 6.0);
        }
        assert_eq!(
            scored(&mut *with(&[["pre", "none"]]).unwrap(), &mut stream(&[])),
            2.0
        );
    }

    #[test]
    fn a_number_names_a_design() {
        let worth = |number: u64| {
            let config = Config {
                drawn: Some(number),
                ..Config::default()
            };
            let mut agent = build(config, &interface(), &mut stream(&[])).unwrap();
            let first = scored(&mut *agent, &mut stream(&["one"]));
            assert_eq!(scored(&mut *agent, &mut stream(&["another"])), first);
            first
        };
        let all: Vec<f64> = (0..300).map(worth).collect();
        let mean = all.iter().sum::<f64>() / 300.0;
        assert!((mean - 2.83).abs() < 0.3 && all.contains(&6.0), "{mean}");
        let twice = Config {
            drawn: Some(1),
            options: vec![vec!["pre".into(), "none".into()]],
            ..Config::default()
        };
        let text = build(twice, &interface(), &mut stream(&[]))
            .err()
            .unwrap()
            .to_string();
        assert!(text.contains("a design is given twice"), "{text}");
    }

    #[test]
    fn options_that_are_not_there_are_named() {
        let text = with(&[["pre", "group"]]).err().unwrap().to_string();
        assert!(
            text.contains("`options.0`: `group` is no option of `norm`; there are: none, batch, instance"),
            "{text}"
        );
        let config = Config {
            options: vec![vec!["pre".into()]],
            ..Config::default()
        };
        let text = build(config, &interface(), &mut stream(&[]))
            .err()
            .unwrap()
            .to_string();
        assert!(
            text.contains("1 options; one is needed for each of: conv, norm"),
            "{text}"
        );
    }

    #[test]
    fn the_choice_of_a_search_is_made_by_its_rank() {
        let folder = tempfile::tempdir().unwrap();
        let Some(contract::Space::Choices(choices)) = interface().seats.pop().map(|seat| seat.action) else {
            unreachable!()
        };
        let design = |candidate: u64, taken: [usize; 2]| Design {
            candidate,
            observed_return: 0.0,
            chosen_by: None,
            actions: vec![choice::vector(&choices, &taken); 2],
            options: Vec::new(),
        };
        let designs = vec![design(4, [1, 2]), design(1, [0, 1])];
        Designs { designs }.write(folder.path()).unwrap();
        let of_rank = |rank: usize| {
            let product = serde_json::json!({ "from": "search", "folder": folder.path() });
            let config = Config {
                design: Some(serde_json::from_value(product).unwrap()),
                rank,
                ..Config::default()
            };
            build(config, &interface(), &mut stream(&[]))
        };
        assert_eq!(scored(&mut *of_rank(0).unwrap(), &mut stream(&[])), 5.0);
        assert_eq!(scored(&mut *of_rank(1).unwrap(), &mut stream(&[])), 2.0);
        let text = of_rank(2).err().unwrap().to_string();
        assert!(
            text.contains("`rank`: the search left 2 designs, 0 to 1"),
            "{text}"
        );
    }
}
