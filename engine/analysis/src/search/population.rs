//! Population based training: settings learn side by side, and the worst take over the networks of the best and
//! continue with a similar setting.
//!
//! Jaderberg et al. 2017, "Population Based Training of Neural Networks", arXiv:1711.09846: exploit by truncation,
//! explore by a factor of 0.8 or 1.2. Here every stretch between two pauses is a trial of its own that continues from
//! the checkpoint of another one, so that the next stretches are a function of stored results. The result is a
//! *schedule*: the settings that lead to the best member, which is then trained again on fresh seeds.

use super::{Method, Next, Point, Population, Range, Search, Tried, best_at, share_of};
use contract::{Rng, random};
use rand::Rng as _;
use serde_json::Value;

/// Factors by which a number moves, down or up.
const FACTORS: [f64; 2] = [0.8, 1.2];

impl Search {
    /// The next step of a method whose members take over from others.
    pub(super) fn evolved(&self, options: &Population, tried: &[Tried]) -> Next {
        let course = self.course(options, tried);
        let stops = vec![None; course.points.len()];
        if !course.is_over {
            return Next::Try(course.points, stops);
        }
        let last = course.points.len() - self.settings;
        let best = self
            .best(tried.get(last..).unwrap_or_default(), |_| true)
            .map(|place| last + place);
        Next::Chosen(best, stops)
    }

    /// The generations of a population, as far as there are results.
    fn course(&self, options: &Population, tried: &[Tried]) -> Course {
        let points = self.generation(&[], self.settings);
        let mut course = Course {
            parents: vec![None; points.len()],
            points,
            is_over: false,
        };
        for (number, pause) in options.pauses.iter().enumerate() {
            let begin = course.points.len() - self.settings;
            let last = course.known(tried).map(|known| &known[begin..]);
            let has_paused = |it: &Tried| it.pauses.contains_key(pause);
            let Some(last) = last.filter(|last| last.iter().all(has_paused)) else {
                return course;
            };
            let Some(next) = next(self, options, number + 1, last, *pause) else {
                course.is_over = true;
                return course;
            };
            course.points.extend(next.points);
            let parents = next.parents.into_iter().map(|place| Some(begin + place));
            course.parents.extend(parents);
        }
        let begin = course.points.len() - self.settings;
        let known = course.known(tried);
        course.is_over = known.is_some_and(|known| known[begin..].iter().all(|it| it.ended));
        course
    }

    /// For each next setting, the place of the one whose learning it continues.
    #[must_use]
    pub fn parents(&self, tried: &[Tried]) -> Vec<Option<usize>> {
        match &self.method {
            Method::Population(options) => self.course(options, tried).parents,
            _ => Vec::new(),
        }
    }

    /// Steps at which members of a population are compared; none for other methods.
    #[must_use]
    pub fn generation_ends(&self) -> &[u64] {
        match &self.method {
            Method::Population(options) => &options.pauses,
            _ => &[],
        }
    }

    /// The step at which a setting of a population, by its place, is compared with its generation; `None` if that is
    /// its end.
    #[must_use]
    pub fn compared_at(&self, place: usize) -> Option<u64> {
        self.generation_ends().get(place / self.settings.max(1)).copied()
    }

    /// Whether members learn side by side and take over from others.
    #[must_use]
    pub fn is_population(&self) -> bool {
        matches!(self.method, Method::Population(_))
    }
}

/// The settings of a population so far.
struct Course {
    points: Vec<Point>,
    parents: Vec<Option<usize>>,
    is_over: bool,
}

impl Course {
    /// The results of these settings; `None` if other settings were tried.
    fn known<'t>(&self, tried: &'t [Tried]) -> Option<&'t [Tried]> {
        let known = tried.get(..self.points.len())?;
        let own = self.points.iter().zip(&self.parents);
        let is_same = |(it, (point, parent)): (&Tried, (&Point, &Option<usize>))| {
            it.point == *point && it.parent == *parent
        };
        known.iter().zip(own).all(is_same).then_some(known)
    }
}

/// The members of a generation after the first.
struct Generation {
    /// Settings of the members, in order.
    points: Vec<Point>,
    /// The place, in the previous generation, of the member from which each continues.
    parents: Vec<usize>,
}

/// The generation after one whose members are `last`, each with its value at the pause; `None` if every one has failed.
/// All members that failed are replaced, regardless of their number.
fn next(
    search: &Search,
    options: &Population,
    number: usize,
    last: &[Tried],
    pause: u64,
) -> Option<Generation> {
    let members = last.len();
    let ranked = best_at(search.direction, last, 0..members, pause)?;
    let replaced = share_of(members, options.replace).clamp(1, (members / 2).max(1));
    let kept = &ranked[..ranked.len().min(members - replaced)];
    let best = &ranked[..ranked.len().min(replaced)];
    if best.is_empty() {
        return None;
    }
    let member = |place: usize| {
        if kept.contains(&place) {
            return (last[place].point.clone(), place);
        }
        let mut rng = random::stream(&["population", &search.identity(), &format!("{number} {place}")]);
        let parent = best[rng.random_range(0..best.len())];
        (explored(search, options, &last[parent].point, &mut rng), parent)
    };
    let (points, parents) = (0..members).map(member).unzip();
    Some(Generation { points, parents })
}

/// A setting similar to another one.
fn explored(search: &Search, options: &Population, point: &[Value], rng: &mut Rng) -> Point {
    let keys = search.keys.iter().zip(point);
    keys.map(|((_, range), value)| {
        if rng.random_bool(options.redraw) {
            range.at(rng.random())
        } else {
            moved(range, value, rng.random_bool(0.5))
        }
    })
    .collect()
}

/// A value near another one: a number times a factor, a whole number moved by at least one, a listed value moved to a
/// neighbour in the list. Values are clamped to the range.
fn moved(range: &Range, value: &Value, up: bool) -> Value {
    match range {
        Range::Choice(values) => {
            let place = values
                .iter()
                .position(|listed| listed == value)
                .unwrap_or_default();
            let next = if up { place + 1 } else { place.saturating_sub(1) };
            values[next.min(values.len() - 1)].clone()
        }
        Range::Numbers(numbers) => {
            let known = value.as_f64().unwrap_or(numbers.low);
            let to = known * FACTORS[usize::from(up)];
            if !numbers.integer {
                return numbers.nearest(to);
            }
            let least = if up { known + 1.0 } else { known - 1.0 };
            let to = if up { to.max(least) } else { to.min(least) };
            numbers.nearest(to.round())
        }
    }
}

/// The settings that lead to a member, from the first generation on, as places.
#[must_use]
pub fn lineage(parents: &[Option<usize>], place: usize) -> Vec<usize> {
    let mut way: Vec<usize> =
        std::iter::successors(Some(place), |at| parents.get(*at).copied().flatten()).collect();
    way.reverse();
    way
}

/// A schedule as text: each setting with the step up to which it holds.
#[must_use]
pub fn schedule_in_words(settings: &[String], pauses: &[u64]) -> String {
    let until = |place: usize| {
        pauses
            .get(place)
            .map_or_else(|| "the end".into(), |step| format!("step {step}"))
    };
    let mut parts: Vec<String> = Vec::new();
    for (place, setting) in settings.iter().enumerate() {
        if settings.get(place + 1) != Some(setting) {
            parts.push(format!("{setting} to {}", until(place)));
        }
    }
    parts.join(", then ")
}

#[cfg(test)]
#[path = "population_tests.rs"]
mod tests;
