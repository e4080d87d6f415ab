//! Cores and graphics cards: the needs of a trial, the capacity of a machine, and its division among trials.
//!
//! A trial has one core and no card of its own, unless its agent is a program that asks for other resources. Resources
//! are not part of a trial's id: they only decide when and where a trial runs.

use crate::Error;
use document::count::count;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The key under which an agent that trains itself declares the needs of a trial.
pub(crate) const NEEDS: &str = "needs";

/// Number of units in which a card is shared.
const CARD: u32 = 1000;

/// The cores and graphics cards that a trial needs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Needs {
    /// Number of cores, and the value of `OMP_NUM_THREADS` and similar variables.
    #[schemars(range(min = 1, max = 65536))]
    pub cores: u32,
    /// Graphics cards: a whole number, or a share of one as 0.25, to a thousandth. `CUDA_VISIBLE_DEVICES` names those
    /// that a trial is given. Absent: a program sees what the machine shows it, and none is counted; 0: it sees none.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1024.0))]
    pub gpus: Option<f64>,
}

impl Default for Needs {
    fn default() -> Self {
        Self { cores: 1, gpus: None }
    }
}

impl Needs {
    /// Refuses needs that no machine can meet.
    ///
    /// # Errors
    /// [`Error::Config`] with the key.
    pub fn check(&self) -> Result<(), Error> {
        let gpus = self.gpus.unwrap_or_default();
        let is_share = gpus < 1.0 && (gpus == 0.0 || gpus >= 0.001);
        let is_whole = gpus >= 1.0 && gpus.fract() == 0.0;
        if self.cores == 0 {
            return Err(Error::config("needs.cores", "a trial needs 1 core or more"));
        }
        if is_share || is_whole {
            return Ok(());
        }
        let problem = format!("{gpus} is neither a whole number of cards nor a share of one, as 0.25");
        Err(Error::config("needs.gpus", problem))
    }

    /// Thousandths of cards.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a number of cards up to 1024 that was checked; others saturate"
    )]
    fn of_cards(&self) -> u32 {
        (self.gpus.unwrap_or_default() * f64::from(CARD)).round() as u32
    }

    /// The needs as text, such as `4 cores and 1 GPU`.
    #[must_use]
    pub fn in_words(&self) -> String {
        let cores = count(self.cores as usize, "core");
        match self.gpus.filter(|gpus| *gpus > 0.0) {
            None => cores,
            Some(gpus) => format!("{cores} and {gpus} GPU{}", if gpus > 1.0 { "s" } else { "" }),
        }
    }
}

/// The cores and graphics cards of a machine, for trials.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Capacity {
    /// Number of cores.
    pub cores: usize,
    /// Cards, as `CUDA_VISIBLE_DEVICES` names them.
    pub gpus: Vec<String>,
}

impl Capacity {
    /// Whether a trial fits while nothing else runs.
    #[must_use]
    pub fn fits(&self, needs: &Needs) -> bool {
        self.cores >= needs.cores as usize && self.gpus.len() * CARD as usize >= needs.of_cards() as usize
    }

    /// The capacity as text, such as `2 cores and no GPU`.
    #[must_use]
    pub fn in_words(&self) -> String {
        let cores = count(self.cores, "core");
        match self.gpus.len() {
            0 => format!("{cores} and no GPU"),
            gpus => format!("{cores} and {}", count(gpus, "GPU")),
        }
    }
}

/// The cores and graphics cards that a trial was given.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Share {
    /// Number of cores that it may use.
    pub cores: u32,
    /// The cards that it sees; `None` if it sees all cards of the machine.
    pub gpus: Option<Vec<String>>,
}

impl Default for Share {
    fn default() -> Self {
        Self { cores: 1, gpus: None }
    }
}

/// Free cores and cards of a machine that trials share.
#[derive(Debug, Clone)]
pub struct Pool {
    capacity: Capacity,
    cores: usize,
    /// Free thousandths of each card.
    gpus: Vec<u32>,
}

impl Pool {
    /// A machine on which nothing runs.
    #[must_use]
    pub fn of(capacity: Capacity) -> Self {
        let (cores, gpus) = (capacity.cores, vec![CARD; capacity.gpus.len()]);
        Self {
            capacity,
            cores,
            gpus,
        }
    }

    /// Whether a trial fits while nothing else runs.
    #[must_use]
    pub fn could_fit(&self, needs: &Needs) -> bool {
        self.capacity.fits(needs)
    }

    /// Whether no core is free.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.cores == 0
    }

    /// Takes the share that a trial needs; `None` if it is not free.
    pub fn take(&mut self, needs: &Needs) -> Option<Share> {
        let cards = self.free_cards(needs)?;
        self.cores = self.cores.checked_sub(needs.cores as usize)?;
        for card in &cards {
            self.gpus[*card] -= needs.of_cards().min(CARD);
        }
        let names = cards
            .iter()
            .map(|card| self.capacity.gpus[*card].clone())
            .collect();
        Some(Share {
            cores: needs.cores,
            gpus: needs.gpus.map(|_| names),
        })
    }

    /// Returns the share of a trial.
    pub fn give_back(&mut self, needs: &Needs, share: &Share) {
        self.cores += share.cores as usize;
        for (card, name) in self.capacity.gpus.iter().enumerate() {
            if share.gpus.as_ref().is_some_and(|names| names.contains(name)) {
                self.gpus[card] += needs.of_cards().min(CARD);
            }
        }
    }

    /// Reserves the kind of resource that a trial lacks if it does not fit now, so that smaller trials that come later
    /// do not take it again and again.
    pub fn reserve(&mut self, needs: &Needs) {
        if self.free_cards(needs).is_none() {
            self.gpus.fill(0);
        }
        if self.cores < needs.cores as usize {
            self.cores = 0;
        }
    }

    /// The cards that a trial would get: free ones for whole cards, or for a share the card with the smallest remainder
    /// that is large enough.
    fn free_cards(&self, needs: &Needs) -> Option<Vec<usize>> {
        let wanted = needs.of_cards();
        if wanted < CARD {
            let fitting = (0..self.gpus.len()).filter(|card| self.gpus[*card] >= wanted);
            let tightest = fitting.min_by_key(|card| self.gpus[*card]);
            return if wanted == 0 {
                Some(Vec::new())
            } else {
                tightest.map(|card| vec![card])
            };
        }
        let wanted = (wanted / CARD) as usize;
        let free = (0..self.gpus.len()).filter(|card| self.gpus[*card] == CARD);
        let cards: Vec<usize> = free.take(wanted).collect();
        (cards.len() == wanted).then_some(cards)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pool(cores: usize, gpus: &[&str]) -> Pool {
        Pool::of(Capacity {
            cores,
            gpus: gpus.iter().map(ToString::to_string).collect(),
        })
    }

    fn needs(cores: u32, gpus: impl Into<Option<f64>>) -> Needs {
        Needs {
            cores,
            gpus: gpus.into(),
        }
    }

    fn cards(pool: &mut Pool, cores: u32, gpus: f64) -> Option<String> {
        let share = pool.take(&needs(cores, gpus))?;
        share.gpus.map(|names| names.join(","))
    }

    #[test]
    fn shares_fill_one_card_before_the_next_and_whole_cards_are_free_ones() {
        let mut pool = pool(8, &["0", "1", "2"]);
        assert_eq!(cards(&mut pool, 1, 0.5).as_deref(), Some("0"));
        assert_eq!(cards(&mut pool, 1, 0.25).as_deref(), Some("0"));
        assert_eq!(cards(&mut pool, 1, 2.0).as_deref(), Some("1,2"));
        assert_eq!(cards(&mut pool, 1, 0.5), None);
        assert_eq!(cards(&mut pool, 1, 0.25).as_deref(), Some("0"));
        assert_eq!(cards(&mut pool, 1, 0.0).as_deref(), Some(""));
        assert_eq!(pool.take(&needs(3, None)).map(|share| share.gpus), Some(None));
        assert!(pool.is_full());
    }

    #[test]
    fn a_reserved_kind_is_kept_and_the_other_is_not() {
        let mut pool = pool(3, &["a"]);
        assert!(pool.take(&needs(1, 1.0)).is_some());
        pool.reserve(&needs(1, 0.5));
        assert!(pool.take(&needs(1, 0.001)).is_none());
        assert!(pool.take(&needs(1, None)).is_some());
        pool.reserve(&needs(2, None));
        assert!(pool.is_full());
    }

    #[test]
    fn what_no_machine_gives_is_refused_by_its_key() {
        for gpus in [0.0, 0.001, 0.25, 1.0, 4.0] {
            assert!(needs(1, gpus).check().is_ok(), "{gpus}");
        }
        for gpus in [1.5, -1.0, 0.0001, f64::NAN] {
            let said = needs(1, gpus).check().unwrap_err().to_string();
            assert!(said.contains("needs.gpus"), "{said}");
        }
        assert!(
            needs(0, None)
                .check()
                .unwrap_err()
                .to_string()
                .contains("needs.cores")
        );
    }

    proptest! {
        /// No card and no core is ever given twice, and all are free at the end.
        #[test]
        fn what_is_given_is_given_back(orders in prop::collection::vec((1u32..4, 0u32..9), 1..60)) {
            let mut pool = pool(6, &["0", "1"]);
            let mut running: Vec<(Needs, Share)> = Vec::new();
            for (cores, quarters) in orders {
                let gpus = if quarters > 4 { 2.0 } else { f64::from(quarters) * 0.25 };
                let needs = needs(cores, gpus);
                match pool.take(&needs) {
                    Some(share) => running.push((needs, share)),
                    None if running.is_empty() => prop_assert!(false, "it fits an empty machine"),
                    None => {
                        let (needs, share) = running.remove(0);
                        pool.give_back(&needs, &share);
                    }
                }
                let cores: u32 = running.iter().map(|(_, share)| share.cores).sum();
                prop_assert!(cores <= 6);
                for card in ["0", "1"] {
                    let on = running.iter().filter(|(_, share)| share.gpus.iter().flatten().any(|it| it == card));
                    let load: f64 = on.map(|(needs, _)| needs.gpus.unwrap_or_default().min(1.0)).sum();
                    prop_assert!(load <= 1.0, "{card}: {load}");
                }
            }
            for (needs, share) in running {
                pool.give_back(&needs, &share);
            }
            prop_assert_eq!((pool.cores, pool.gpus), (6, vec![CARD; 2]));
        }
    }
}
