//! Crack growth and the outcomes of inspections, as tables over bins of crack sizes.
//!
//! | symbol | here | value |
//! |---|---|---|
//! | d_t | crack size after t years, mm | |
//! | d_0 | first size | exponential, mean 1 mm |
//! | C, m | Paris law | ln C normal, mean -35.2, deviation 0.5; m = 3.5 |
//! | S | stress range, MPa | normal, mean 70, deviation 10 |
//! | N | cycles in a year | 1e6 |
//! | d_c | critical size, mm | 20 |
//! | p, K | (m - 2) / 2, C (sqrt(pi) S)^m N | |
//!
//! C and S are drawn once for a component and kept, so that the law d' = C (S sqrt(pi d))^m has the solution
//! `d_t^(-p) = d_0^(-p) - p K t`, and a size of at least `E` after t years corresponds to an initial size of at
//! least `e(t) = (E^(-p) + p K t)^(-1/p)`. A crack beyond d_c has failed and stays so.
//!
//! **Table.** `P(d_(t+1) in bin k | d_t in bin j)` is a ratio of two probabilities. Given K both are masses of
//! the exponential distribution between edges that are pulled back to year 0; over K they are averaged by the
//! trapezoidal rule in the two standard normals, whose error falls faster than any power of its step. A bin of
//! zero probability keeps its cracks.
//!
//! Range of validity: linear elastic growth of one crack under loads of constant range; bins below 0.0001 mm
//! stand for the absence of a crack. Constants and bins: P. Leroy, P. G. Morato, J. Pisane, A. Kolios and D.
//! Ernst, "IMP-MARL: a suite of environments for large-scale infrastructure management planning via MARL",
//! NeurIPS 2023.

use arithmetic::double::{exp, exp_m1, ln};
use arithmetic::power::pow;
use contract::{DataFile, Error};
use serde::Deserialize;
use std::{
    collections::BTreeMap,
    f64::consts::PI,
    sync::{Arc, Mutex, PoisonError, Weak},
};

/// Number of bins of crack sizes; the last one holds failed components.
pub const N_BINS: usize = 30;
/// Number of ages, in years without a repair, in the table.
pub const N_AGES: usize = 30;
/// Position of the bin of failed components.
pub const FAILED: usize = N_BINS - 1;

const SMALLEST_EDGE_MM: f64 = 1e-4;
const CRITICAL_SIZE_MM: f64 = 20.0;
const FIRST_SIZE_MM: f64 = 1.0;
const PARIS_EXPONENT: f64 = 3.5;
const LN_C_MEAN: f64 = -35.2;
const LN_C_SD: f64 = 0.5;
const STRESS_MEAN_MPA: f64 = 70.0;
const STRESS_SD_MPA: f64 = 10.0;
const CYCLES_PER_YEAR: f64 = 1e6;
/// Crack size that an inspection finds with a probability of 1 - 1/e, mm.
const DETECTABLE_SIZE_MM: f64 = 8.0;
/// Crack size of failed components in an inspection, mm.
const FAILED_SIZE_MM: f64 = 21.0;
/// Range of the standard normals on both sides of 0, in steps of [`STEP`].
const REACH: i32 = 24;
const STEP: f64 = 0.25;

/// Probabilities over the bins.
pub type Belief = [f64; N_BINS];

/// Crack growth within a year by age, and the initial sizes of new and repaired components.
#[derive(Debug, Clone, PartialEq)]
pub struct CrackGrowth {
    /// For each age and bin the following bins with their probabilities; zeros are left out.
    rows: Vec<Vec<Vec<(usize, f64)>>>,
    /// Initial sizes of a new or repaired component.
    pub initial: Belief,
}

impl CrackGrowth {
    /// The table of the law above, computed once within a process.
    #[must_use]
    pub fn of_paris_law() -> Arc<Self> {
        Self::accelerated(1.0)
    }

    /// The table with `times` the cycles in a year.
    #[must_use]
    pub fn accelerated(times: f64) -> Arc<Self> {
        static COMPUTED: Mutex<BTreeMap<u64, Arc<CrackGrowth>>> = Mutex::new(BTreeMap::new());
        let compute = || {
            let joint = joint_probabilities(times);
            Arc::new(Self {
                rows: joint.iter().map(conditional).collect(),
                initial: first_sizes(),
            })
        };
        // A panic while the lock was held has left the map unchanged.
        let mut computed = COMPUTED.lock().unwrap_or_else(PoisonError::into_inner);
        computed.entry(times.to_bits()).or_insert_with(compute).clone()
    }

    /// A table from a file: columns `rate` (years without a repair), `from`, `to` (bins from 0) and `p`; rows
    /// without `rate` and `from` are the initial sizes. A table that another environment uses is not read
    /// again.
    ///
    /// # Errors
    /// [`Error::File`] and [`Error::Input`] for a file that cannot be read, is not such a table, or has rows
    /// that do not sum to 1.
    pub fn of_file(file: &DataFile) -> Result<Arc<Self>, Error> {
        static IN_USE: Mutex<BTreeMap<String, Weak<CrackGrowth>>> = Mutex::new(BTreeMap::new());
        let key = file.digest()?.into_owned();
        // A panic while the lock was held has left the map unchanged.
        let mut in_use = IN_USE.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = in_use.get(&key).and_then(Weak::upgrade) {
            return Ok(known);
        }
        let read = Arc::new(Self::read(file)?);
        in_use.retain(|_, growth| growth.strong_count() > 0);
        in_use.insert(key, Arc::downgrade(&read));
        Ok(read)
    }

    fn read(file: &DataFile) -> Result<Self, Error> {
        let text = file.text()?;
        let mut read = Self {
            rows: vec![vec![Vec::new(); N_BINS]; N_AGES],
            initial: [0.0; N_BINS],
        };
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        for (index, entry) in reader.deserialize().enumerate() {
            let entry: Entry = entry.map_err(|source| wrong(file, Some(index), source.to_string()))?;
            read.take(&entry)
                .map_err(|problem| wrong(file, Some(index), problem))?;
        }
        read.check().map_err(|problem| wrong(file, None, problem))?;
        Ok(read)
    }

    /// Sizes one year later of a component of this age; ages beyond the table have its last row.
    #[must_use]
    pub fn grow(&self, age: usize, belief: &Belief) -> Belief {
        let mut next = [0.0; N_BINS];
        for (row, weight) in self.rows[age.min(N_AGES - 1)].iter().zip(belief) {
            row.iter().for_each(|(to, p)| next[*to] += weight * p);
        }
        next
    }

    fn take(&mut self, entry: &Entry) -> Result<(), String> {
        let bin = |of: usize| {
            if of < N_BINS {
                Ok(of)
            } else {
                Err(format!("{of} is no bin below {N_BINS}"))
            }
        };
        let to = bin(entry.to)?;
        match (entry.rate, entry.from) {
            (None, None) => self.initial[to] = entry.p,
            (Some(rate), Some(from)) if rate < N_AGES => self.rows[rate][bin(from)?].push((to, entry.p)),
            // An age that no episode reaches.
            (Some(_), Some(_)) => {}
            _ => return Err("`rate` and `from` stand together".into()),
        }
        Ok(())
    }

    fn check(&self) -> Result<(), String> {
        let is_one = |sum: f64| (sum - 1.0).abs() < 1e-6;
        if !is_one(self.initial.iter().sum()) {
            return Err("the first sizes (rows without `rate`) do not sum to 1".into());
        }
        for (age, rows) in self.rows.iter().enumerate() {
            let sums = rows.iter().map(|row| row.iter().map(|(_, p)| p).sum::<f64>());
            if let Some((from, sum)) = sums.enumerate().find(|(_, sum)| !is_one(*sum)) {
                return Err(format!("rate {age}, from {from}: probabilities sum to {sum}"));
            }
        }
        Ok(())
    }
}

/// A row of a file.
#[derive(Debug, Deserialize)]
struct Entry {
    rate: Option<usize>,
    from: Option<usize>,
    to: usize,
    p: f64,
}

fn wrong(file: &DataFile, row: Option<usize>, problem: String) -> Error {
    Error::Input {
        path: file.path().to_owned(),
        // Rows stand below the header, and lines are counted from 1.
        line: row.map(|row| row as u64 + 2),
        column: None,
        problem,
    }
}

/// Edges of the bins, mm: 0, then 29 edges with equal steps of their logarithms up to the critical size; the
/// last bin is open.
#[must_use]
pub fn edges_mm() -> [f64; N_BINS] {
    let (low, high) = (ln(SMALLEST_EDGE_MM), ln(CRITICAL_SIZE_MM));
    std::array::from_fn(|at| match at {
        0 => 0.0,
        FAILED => CRITICAL_SIZE_MM,
        #[allow(clippy::cast_precision_loss, reason = "a number of bins")]
        _ => exp(low + (at - 1) as f64 * (high - low) / 28.0),
    })
}

/// Probability that an inspection finds the crack, by bin: `1 - exp(-c / 8)` for a bin around `c` mm.
#[must_use]
pub fn detection() -> Belief {
    let edges = edges_mm();
    std::array::from_fn(|bin| {
        let center = edges
            .get(bin + 1)
            .map_or(FAILED_SIZE_MM, |next| f64::midpoint(edges[bin], *next));
        -exp_m1(-center / DETECTABLE_SIZE_MM)
    })
}

/// Probability of an initial size of at most `size_mm`.
#[must_use]
pub fn first_size_cdf(size_mm: f64) -> f64 {
    -exp_m1(-size_mm / FIRST_SIZE_MM)
}

/// Masses of the initial sizes in the bins.
#[must_use]
pub fn first_sizes() -> Belief {
    masses(&edges_mm().map(first_size_cdf))
}

/// Masses between the cumulative probabilities of the edges; the last bin is open.
#[must_use]
pub fn masses(below: &[f64; N_BINS]) -> Belief {
    std::array::from_fn(|bin| below.get(bin + 1).unwrap_or(&1.0) - below[bin])
}

/// `P(d_t in j, d_(t+1) in k)` for each age t.
fn joint_probabilities(times: f64) -> Vec<[Belief; N_BINS]> {
    let mut joint = vec![[[0.0; N_BINS]; N_BINS]; N_AGES];
    for (growth, weight) in growth_factors() {
        let growth = times * growth;
        let mut earlier = pulled_back(growth, 0);
        for (age, of_age) in joint.iter_mut().enumerate() {
            let later = pulled_back(growth, age + 1);
            add_overlaps(of_age, &earlier, &later, weight);
            earlier = later;
        }
    }
    joint
}

/// Values of `p K` with their weights, whose sum is nearly 1.
fn growth_factors() -> impl Iterator<Item = (f64, f64)> {
    let normals = || (-REACH..=REACH).map(|step| f64::from(step) * STEP);
    let of = |x: f64, y: f64| {
        let stress = STRESS_MEAN_MPA + STRESS_SD_MPA * y;
        let c = exp(LN_C_MEAN + LN_C_SD * x);
        let k = c * pow(PI.sqrt() * stress, PARIS_EXPONENT) * CYCLES_PER_YEAR;
        let density = exp(-0.5 * (x * x + y * y)) / (2.0 * PI);
        (exponent() * k, density * STEP * STEP)
    };
    normals().flat_map(move |x| normals().map(move |y| of(x, y)))
}

/// The exponent p.
fn exponent() -> f64 {
    (PARIS_EXPONENT - 2.0) / 2.0
}

/// Fraction of components whose initial size was above the one that reaches each edge in `years`.
fn pulled_back(growth: f64, years: usize) -> Belief {
    #[allow(clippy::cast_precision_loss, reason = "a number of years")]
    let grown = growth * years as f64;
    let p = exponent();
    let first_size = |edge: f64| {
        if edge > 0.0 {
            pow(pow(edge, -p) + grown, -1.0 / p)
        } else {
            0.0
        }
    };
    edges_mm().map(|edge| exp(-first_size(edge) / FIRST_SIZE_MM))
}

/// Adds the mass of every present bin `j` within every bin `k` of the next year; both are intervals of initial
/// sizes, and `now` and `later` are the fractions above their lower ends.
fn add_overlaps(joint: &mut [Belief; N_BINS], now: &Belief, later: &Belief, weight: f64) {
    let end = |above: &Belief, bin: usize| above.get(bin + 1).copied().unwrap_or(0.0);
    let (mut j, mut k) = (0, 0);
    while j < N_BINS && k < N_BINS {
        let above = now[j].min(later[k]);
        let (end_j, end_k) = (end(now, j), end(later, k));
        joint[j][k] += weight * (above - end_j.max(end_k)).max(0.0);
        if end_j >= end_k { j += 1 } else { k += 1 }
    }
}

fn conditional(joint: &[Belief; N_BINS]) -> Vec<Vec<(usize, f64)>> {
    let row = |(from, masses): (usize, &Belief)| {
        let sum: f64 = masses.iter().sum();
        if sum <= 0.0 {
            return vec![(from, 1.0)];
        }
        let shares = masses.iter().map(|mass| mass / sum).enumerate();
        shares.filter(|(_, share)| *share > 0.0).collect()
    };
    joint.iter().enumerate().map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use arithmetic::draws::normal;
    use contract::random::stream;
    use rand::Rng as _;
    use std::io::Write as _;

    fn published() -> Arc<CrackGrowth> {
        let path = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../experiments/data/imp_marl_crack_growth.csv"
        );
        CrackGrowth::of_file(&DataFile::new(path)).unwrap()
    }

    fn dense(growth: &CrackGrowth, age: usize, from: usize) -> Belief {
        growth.grow(age, &std::array::from_fn(|bin| f64::from(u8::from(bin == from))))
    }

    /// `K` grows with the cycles, so two years at once are two consecutive years.
    #[test]
    fn twice_the_cycles_are_two_years_in_one() {
        let (once, twice) = (CrackGrowth::of_paris_law(), CrackGrowth::accelerated(2.0));
        let later = once.grow(1, &once.grow(0, &once.initial));
        let at_once = twice.grow(0, &twice.initial);
        assert!(
            later.iter().zip(&at_once).all(|(a, b)| (a - b).abs() < 1e-9),
            "{later:?} {at_once:?}"
        );
        assert!(at_once[FAILED] > 1.5 * once.grow(0, &once.initial)[FAILED]);
    }

    #[test]
    fn every_row_is_a_distribution_and_cracks_never_shrink() {
        let growth = CrackGrowth::of_paris_law();
        assert!((growth.initial.iter().sum::<f64>() - 1.0).abs() < 1e-14);
        for age in 0..N_AGES {
            for from in 0..N_BINS {
                let row = dense(&growth, age, from);
                assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{age} {from}");
                assert!(row[..from].iter().all(|p| *p == 0.0), "{age} {from}: {row:?}");
            }
            assert_eq!(dense(&growth, age, FAILED)[FAILED], 1.0);
        }
    }

    /// The published table was counted from ten million samples, spread over the bins by their mass: every
    /// entry lies within six standard deviations of such a count.
    #[test]
    fn the_published_table_is_met_as_well_as_it_was_sampled() {
        const SAMPLES: f64 = 1e7;
        let (ours, theirs) = (CrackGrowth::of_paris_law(), published());
        let within = |p: f64, counted: f64, held: f64| {
            let deviation = ((p * (1.0 - p)).max(1e-6) / held).sqrt();
            (p - counted).abs() < 6.0 * deviation + 1e-6
        };
        let (mut compared, mut belief) = (0, first_sizes());
        for age in 0..N_AGES {
            for (from, mass) in belief
                .iter()
                .enumerate()
                .filter(|(_, mass)| **mass * SAMPLES > 30.0)
            {
                let rows = dense(&ours, age, from).into_iter().zip(dense(&theirs, age, from));
                for (to, (p, counted)) in rows.enumerate() {
                    assert!(
                        within(p, counted, mass * SAMPLES),
                        "age {age}, {from} to {to}: {p} {counted}"
                    );
                }
                compared += 1;
            }
            belief = ours.grow(age, &belief);
        }
        assert!(compared > 700, "{compared} rows");
        let first = ours.initial.iter().zip(theirs.initial);
        assert!(
            first.into_iter().all(|(p, counted)| within(*p, counted, SAMPLES)),
            "{:?}",
            ours.initial
        );
    }

    /// The law itself, integrated sample by sample and year by year, without its closed form.
    #[test]
    fn integrated_samples_fail_as_often_as_the_table_says() {
        let mut rng = stream(&["cracks"]);
        let (samples, years, steps) = (20_000, 20, 20);
        let mut failed = 0;
        for _ in 0..samples {
            let mut size = -(1.0 - rng.random::<f64>()).ln();
            let c = (LN_C_MEAN + LN_C_SD * normal(rng.random())).exp();
            let range = STRESS_MEAN_MPA + STRESS_SD_MPA * normal(rng.random());
            for _ in 0..years * steps {
                // A step of Heun's method, in the logarithm of the size.
                let speed = |size: f64| {
                    c * (range * (PI * size).sqrt()).powf(PARIS_EXPONENT) * CYCLES_PER_YEAR / size
                };
                let step = 1.0 / f64::from(steps);
                let ahead = size * (speed(size) * step).exp();
                size *= (0.5 * step * (speed(size) + speed(ahead.min(40.0)))).exp();
                if size > CRITICAL_SIZE_MM {
                    failed += 1;
                    break;
                }
            }
        }
        let growth = CrackGrowth::of_paris_law();
        let belief = (0..20).fold(growth.initial, |belief, age| growth.grow(age, &belief));
        let share = f64::from(failed) / f64::from(samples);
        // A share of 0.02 of 20 000 has a standard deviation of 0.001.
        assert!(
            (share - belief[FAILED]).abs() < 0.004,
            "{share} {}",
            belief[FAILED]
        );
    }

    #[test]
    fn the_probability_of_detection_grows_with_the_crack() {
        let detection = detection();
        assert!(detection.is_sorted());
        // The published value, to the last digit.
        assert!((detection[1] - 1.591_488_801_864_027e-5).abs() < 1e-16);
        assert!((detection[28] - 0.872_332_722_771_346_7).abs() < 1e-12);
        assert!((detection[FAILED] - 0.927_560_242_965_748_6).abs() < 1e-15);
    }

    #[test]
    fn a_file_that_is_no_table_is_refused_with_its_line() {
        let refused = |rows: &str| {
            let mut file = tempfile::NamedTempFile::new().unwrap();
            write!(file, "rate,from,to,p\n{rows}").unwrap();
            CrackGrowth::of_file(&DataFile::new(file.path()))
                .unwrap_err()
                .to_string()
        };
        for (rows, text) in [
            (",,0,1\n0,0,30,1\n", "30 is no bin below 30"),
            (",0,0,1\n", "`rate` and `from` stand together"),
            (",,0,0.5\n", "first sizes"),
            (",,0,1\n0,0,0,0.25\n", "rate 0, from 0: probabilities sum to 0.25"),
        ] {
            let problem = refused(rows);
            assert!(problem.contains(text), "{problem}");
        }
        assert!(refused(",,0,1\n0,0,x,1\n").contains('3'));
    }
}
