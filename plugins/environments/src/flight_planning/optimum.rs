//! The plan of least consumption, by dynamic programming backwards over the legs.
//!
//! `E_i(h)`, the least consumption of legs i to n for a UAV that comes from height h, is the least sum of the
//! consumption of leg i on a course and `E_{i+1}` of the height of that course. Legs are coupled only by their
//! heights, so this is exact.

use super::mission::{Course, HEIGHTS_M, Mission};

/// The best courses of the remaining legs from a height.
#[derive(Debug, Clone)]
struct RemainingPlan {
    total_j: f64,
    plan: Vec<Course>,
}

/// The plan of least consumption in the mean wind, the first of equals.
#[must_use]
pub fn optimum(mission: &Mission) -> Vec<Course> {
    let end = RemainingPlan {
        total_j: 0.0,
        plan: Vec::new(),
    };
    let mut from_heights = vec![end; HEIGHTS_M.len()];
    for leg in (1..mission.legs.len()).rev() {
        from_heights = HEIGHTS_M
            .iter()
            .map(|height_m| best(mission, leg, *height_m, &from_heights))
            .collect();
    }
    best(mission, 0, 0.0, &from_heights).plan
}

/// The best courses from a height over a leg and all that follow.
fn best(mission: &Mission, leg: usize, from_m: f64, after: &[RemainingPlan]) -> RemainingPlan {
    let one = |course: Course| {
        let segment = mission.segment(&mission.legs[leg], course, from_m, 1.0, 1.0);
        let rest = HEIGHTS_M.iter().position(|height_m| *height_m == course.height_m);
        let rest = &after[rest.unwrap_or_default()];
        (mission.consumption_j(&segment) + rest.total_j, course, rest)
    };
    let mut ways = Course::all().map(one);
    let first = ways.next();
    let least = ways.fold(first, |least, way| match least {
        Some(known) if known.0 <= way.0 => Some(known),
        _ => Some(way),
    });
    // There are 21 courses.
    let (total_j, course, rest) = least.expect("courses are constants");
    let plan = [course].into_iter().chain(rest.plan.iter().copied()).collect();
    RemainingPlan { total_j, plan }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flight_planning::mission::Leg;

    /// The least consumption of all plans, tried one by one.
    fn by_trying_all(mission: &Mission) -> f64 {
        let n = Course::all().count();
        let plans = n.pow(u32::try_from(mission.legs.len()).unwrap());
        let courses: Vec<Course> = Course::all().collect();
        (0..plans)
            .map(|number| {
                let plan: Vec<Course> = (0..mission.legs.len())
                    .scan(number, |rest, _| {
                        let course = courses[*rest % n];
                        *rest /= n;
                        Some(course)
                    })
                    .collect();
                mission.total_j(&plan)
            })
            .fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn dynamic_programming_finds_what_trying_all_finds() {
        for (wind_m_per_s, wind_from_deg) in [(0.0, 0.0), (5.0, 250.0), (7.0, 10.0), (3.0, 120.0)] {
            let leg = |length_m, heading_deg| Leg {
                length_m,
                heading_deg,
            };
            let mission = Mission {
                legs: vec![leg(3000.0, 0.0), leg(800.0, 100.0), leg(5000.0, 200.0)],
                wind_m_per_s,
                wind_from_deg,
                loss_per_w: 5e-4,
            };
            let found = mission.total_j(&optimum(&mission));
            let least = by_trying_all(&mission);
            assert!((found / least - 1.0).abs() < 1e-12, "{found} {least}");
        }
    }

    /// In still air a climb gains nothing, and 18 m/s is nearest to the speed of the longest range.
    #[test]
    fn in_still_air_every_leg_is_flown_alike() {
        let mission = Mission {
            wind_m_per_s: 0.0,
            ..Mission::default()
        };
        let plan = optimum(&mission);
        assert!(plan.iter().all(|course| *course == Course::of(3, 0)), "{plan:?}");
    }

    #[test]
    fn wind_makes_a_plan_worth_its_while() {
        let mission = Mission::default();
        let plan = optimum(&mission);
        let saved = 1.0 - mission.total_j(&plan) / mission.total_j(&mission.constant_plan());
        assert!((0.005..0.3).contains(&saved), "{saved} {plan:?}");
        assert!(plan.iter().any(|course| *course != plan[0]), "{plan:?}");
    }
}
