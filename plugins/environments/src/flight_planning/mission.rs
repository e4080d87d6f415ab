//! The mission of a flight: legs over ground, a wind that grows with height, and the consumption of a plan.
//!
//! | symbol | here | unit |
//! |---|---|---|
//! | V | airspeed; V_g for a course at a constant speed over ground, with V from it | m/s |
//! | w(h) = w_10 (h / 10 m)^(1/7) | `Mission::wind_at` | m/s |
//! | w_a, w_c | its components along the leg and across it | m/s |
//! | V_g = w_a + sqrt(V^2 - w_c^2) | speed over ground, with the nose turned into the wind | m/s |
//! | P, t | electrical power, duration | W, s |
//! | kappa = R / (N U^2) | `loss_per_w`: ohmic loss of a pack of N cells at a voltage U, over the square of its power | 1/W |
//! | t (P + kappa P^2) | [`Mission::consumption_j`]: energy from the cells, with their own loss | J |
//!
//! Without the loss the best plan flies so fast against the wind that a worn pack sags to its end of discharge.
//!
//! The exponent 1/7 is that of open, flat country (E. W. Peterson and J. P. Hennessey, "On the use of power laws
//! for estimates of wind power potential", Journal of Applied Meteorology 17 (1978) 390-394). A leg is flown at
//! one airspeed and one height; the climb to it is flown along the way, and its energy is spread over the leg.

use super::power::{climb_j, level_w};
use arithmetic::{
    power::pow,
    trigonometry::{cos, sin},
};
use contract::Error;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Airspeeds for the choice of a plan, m/s.
pub const AIRSPEEDS_M_PER_S: [f64; 7] = [12.0, 14.0, 16.0, 18.0, 20.0, 22.0, 24.0];
/// Heights above ground for the choice of a plan, m. The last one is the limit of the open category of the
/// European rules for UAVs.
pub const HEIGHTS_M: [f64; 3] = [20.0, 60.0, 120.0];
/// Reference height of the mean wind, m.
const WIND_HEIGHT_M: f64 = 10.0;
const WIND_EXPONENT: f64 = 1.0 / 7.0;

/// A straight part of the route over ground.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Leg {
    /// Length over ground.
    #[schemars(range(min = 1.0, max = 1e6), extend("x-unit" = "m"))]
    pub length_m: f64,
    /// Direction of flight, clockwise from north.
    #[schemars(range(min = -360.0, max = 360.0), extend("x-unit" = "deg"))]
    pub heading_deg: f64,
}

/// The legs of a flight and the mean wind.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Mission {
    /// The legs, in order.
    #[schemars(length(min = 1, max = 20))]
    pub legs: Vec<Leg>,
    /// Mean wind 10 m above ground.
    #[schemars(range(min = 0.0, max = 20.0), extend("x-unit" = "m/s", "x-source" = "own choice: a moderate breeze"))]
    pub wind_m_per_s: f64,
    /// Direction from which the wind comes, clockwise from north.
    #[schemars(range(min = -360.0, max = 360.0), extend("x-unit" = "deg"))]
    pub wind_from_deg: f64,
    /// Ohmic loss of the pack over the square of its power, R / (N U^2), which counts in the comparison of
    /// plans.
    #[schemars(range(min = 0.0, max = 1.0), extend("x-unit" = "1/W",
        "x-source" = "16 cells of 0.15 ohm at 3.4 V"))]
    pub loss_per_w: f64,
}

impl Default for Mission {
    /// A loop of six legs of 3 km, so that the wind comes from all sides.
    fn default() -> Self {
        let leg = |turn: u32| Leg {
            length_m: 3000.0,
            heading_deg: 60.0 * f64::from(turn),
        };
        Self {
            legs: (0..6).map(leg).collect(),
            wind_m_per_s: 5.0,
            wind_from_deg: 250.0,
            loss_per_w: 8.1e-4,
        }
    }
}

/// The constant speed on a leg, m/s.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Speed {
    /// Speed through the air.
    Air(f64),
    /// Speed over ground, as autopilots hold it on a route of waypoints.
    Ground(f64),
}

/// Speed and height on a leg.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Course {
    /// The constant speed.
    pub speed: Speed,
    /// Height above ground, m.
    pub height_m: f64,
}

impl Course {
    /// The course of the constant plan: one speed over ground whatever the wind, near the ground. In 1.5 times
    /// the default wind it is the largest whole speed that needs at most the fastest airspeed of the plans.
    pub const CONSTANT: Self = Self {
        speed: Speed::Ground(15.0),
        height_m: HEIGHTS_M[0],
    };

    /// All courses of a leg: heights within airspeeds.
    pub fn all() -> impl Iterator<Item = Self> {
        (0..AIRSPEEDS_M_PER_S.len())
            .flat_map(|airspeed| (0..HEIGHTS_M.len()).map(move |height| Self::of(airspeed, height)))
    }

    /// The course at the positions of an airspeed and a height.
    #[must_use]
    pub fn of(airspeed: usize, height: usize) -> Self {
        Self {
            speed: Speed::Air(AIRSPEEDS_M_PER_S[airspeed]),
            height_m: HEIGHTS_M[height],
        }
    }
}

/// A period of constant power.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Electrical power, W.
    pub power_w: f64,
    /// Duration, s.
    pub duration_s: f64,
}

impl Segment {
    /// Electrical energy, J.
    #[must_use]
    pub fn energy_j(&self) -> f64 {
        self.power_w * self.duration_s
    }
}

impl Mission {
    /// Checks the wind, at its strongest, against the slowest airspeed, so that every leg can be flown in every
    /// plan.
    ///
    /// # Errors
    /// [`Error::Config`] for numbers outside their ranges and for a wind that is too strong.
    pub fn check(&self, key: &str, strongest: f64) -> Result<(), Error> {
        let refused = |name: &str, problem: String| Err(Error::config(format!("{key}{name}"), problem));
        if !(1..=20).contains(&self.legs.len()) {
            return refused("legs", format!("{} legs are not 1 to 20", self.legs.len()));
        }
        let is_leg = |leg: &Leg| (1.0..=1e6).contains(&leg.length_m) && leg.heading_deg.abs() <= 360.0;
        if let Some(place) = self.legs.iter().position(|leg| !is_leg(leg)) {
            let problem = "a length of 1 to 1e6 m and a heading of -360 to 360 degrees are needed".into();
            return refused(&format!("legs[{place}]"), problem);
        }
        if !(0.0..=1.0).contains(&self.loss_per_w) {
            return refused("loss_per_w", format!("{} is not in 0 to 1", self.loss_per_w));
        }
        if self.wind_from_deg.is_nan() || self.wind_from_deg.abs() > 360.0 {
            return refused(
                "wind_from_deg",
                format!("{} is not in -360 to 360", self.wind_from_deg),
            );
        }
        let (most, slowest) = (strongest * self.wind_at(HEIGHTS_M[2]), AIRSPEEDS_M_PER_S[0]);
        if !(0.0..slowest).contains(&most) {
            let problem = format!(
                "at {} m the wind reaches {most:.1} m/s; it must stay below the slowest airspeed, {slowest} m/s",
                HEIGHTS_M[2]
            );
            return refused("wind_m_per_s", problem);
        }
        Ok(())
    }

    /// Mean wind at a height, m/s.
    #[must_use]
    pub fn wind_at(&self, height_m: f64) -> f64 {
        self.wind_m_per_s * pow(height_m / WIND_HEIGHT_M, WIND_EXPONENT)
    }

    /// Wind along a leg (positive from behind) and across it, m/s, at `strength` times the mean wind.
    #[must_use]
    pub fn wind_on(&self, leg: &Leg, height_m: f64, strength: f64) -> (f64, f64) {
        let angle = (self.wind_from_deg + 180.0 - leg.heading_deg).to_radians();
        let wind = strength * self.wind_at(height_m);
        (wind * cos(angle), wind * sin(angle))
    }

    /// Power and duration of the fraction `share` of a leg, which begins with the climb from `from_m`.
    #[must_use]
    pub fn segment(&self, leg: &Leg, course: Course, from_m: f64, strength: f64, share: f64) -> Segment {
        let Course { speed, height_m } = course;
        let (along, across) = self.wind_on(leg, height_m, strength);
        let (air, ground) = match speed {
            Speed::Air(air) => (air, along + (air * air - across * across).sqrt()),
            Speed::Ground(ground) => {
                let relative = ground - along;
                ((relative * relative + across * across).sqrt(), ground)
            }
        };
        let duration_s = share * leg.length_m / ground;
        let climb_w = climb_j(height_m - from_m) / duration_s;
        Segment {
            power_w: level_w(air) + climb_w,
            duration_s,
        }
    }

    /// Power and duration of each leg of a plan, which begins on the ground.
    ///
    /// # Panics
    /// Where the number of legs of the plan differs from that of the mission.
    #[must_use]
    pub fn segments(&self, plan: &[Course], strength: f64, share: f64) -> Vec<Segment> {
        assert_eq!(plan.len(), self.legs.len(), "legs of a plan");
        let mut height_m = 0.0;
        let one = |(leg, course): (&Leg, &Course)| {
            let segment = self.segment(leg, *course, height_m, strength, share);
            height_m = course.height_m;
            segment
        };
        self.legs.iter().zip(plan).map(one).collect()
    }

    /// Energy from the cells for a segment, with their own loss, J.
    #[must_use]
    pub fn consumption_j(&self, segment: &Segment) -> f64 {
        segment.energy_j() * (1.0 + self.loss_per_w * segment.power_w)
    }

    /// Consumption of a whole plan in the mean wind, J.
    #[must_use]
    pub fn total_j(&self, plan: &[Course]) -> f64 {
        let segments = self.segments(plan, 1.0, 1.0);
        segments.iter().map(|segment| self.consumption_j(segment)).sum()
    }

    /// The constant plan, which flies [`Course::CONSTANT`] on every leg.
    #[must_use]
    pub fn constant_plan(&self) -> Vec<Course> {
        vec![Course::CONSTANT; self.legs.len()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn winds_by_hand() {
        let mission = Mission {
            legs: vec![Leg {
                length_m: 1000.0,
                heading_deg: 0.0,
            }],
            wind_m_per_s: 5.0,
            wind_from_deg: 0.0,
            loss_per_w: 1e-3,
        };
        let leg = mission.legs[0];
        let (along, across) = mission.wind_on(&leg, 10.0, 2.0);
        assert!((along + 10.0).abs() < 1e-12 && across.abs() < 1e-12);
        assert!(
            (mission.wind_at(1280.0) - 10.0).abs() < 1e-12,
            "2^7 times the height"
        );
        let course = Course {
            speed: Speed::Air(20.0),
            height_m: 10.0,
        };
        // Against the wind 15 m/s over ground, and 10 m of climb: 20 N 10 m / 0.7.
        let segment = mission.segment(&leg, course, 0.0, 1.0, 1.0);
        assert!((segment.duration_s - 1000.0 / 15.0).abs() < 1e-9);
        let expected = level_w(20.0) * 1000.0 / 15.0 + 200.0 / 0.7;
        assert!((segment.energy_j() - expected).abs() < 1e-6);
        let lost = 1e-3 * segment.power_w * segment.energy_j();
        assert!((mission.consumption_j(&segment) - expected - lost).abs() < 1e-6);
        // Over ground the same 15 m/s need the same 20 m/s through the air.
        let held = Course {
            speed: Speed::Ground(15.0),
            ..course
        };
        assert_eq!(mission.segment(&leg, held, 0.0, 1.0, 1.0), segment);
        // Wind from the side: sqrt(400 - 25) m/s over ground, no climb.
        let aside = Mission {
            wind_from_deg: 90.0,
            ..mission
        };
        let segment = aside.segment(&leg, course, 10.0, 1.0, 0.5);
        assert!((segment.duration_s - 500.0 / 375.0_f64.sqrt()).abs() < 1e-9);
        assert_eq!(segment.power_w, level_w(20.0));
    }

    #[test]
    fn winds_in_which_a_leg_cannot_be_flown_are_refused() {
        let mission = |wind_m_per_s| Mission {
            wind_m_per_s,
            ..Mission::default()
        };
        assert!(mission(5.0).check("", 1.5).is_ok());
        let text = mission(6.0).check("mission.", 1.5).unwrap_err().to_string();
        assert!(
            text.contains("`mission.wind_m_per_s`: at 120 m the wind reaches 12.8 m/s"),
            "{text}"
        );
        assert!(mission(-1.0).check("", 1.5).is_err());
        let nowhere = Mission {
            legs: Vec::new(),
            ..Mission::default()
        };
        assert!(nowhere.check("", 1.0).unwrap_err().to_string().contains("`legs`"));
        let backwards = Mission {
            legs: vec![Leg {
                length_m: -3.0,
                heading_deg: 0.0,
            }],
            ..Mission::default()
        };
        assert!(
            backwards
                .check("", 1.0)
                .unwrap_err()
                .to_string()
                .contains("`legs[0]`")
        );
        let lossy = Mission {
            loss_per_w: -1.0,
            ..Mission::default()
        };
        assert!(
            lossy
                .check("", 1.0)
                .unwrap_err()
                .to_string()
                .contains("`loss_per_w`")
        );
        let astray = Mission {
            wind_from_deg: 400.0,
            ..Mission::default()
        };
        assert!(
            astray
                .check("", 1.0)
                .unwrap_err()
                .to_string()
                .contains("`wind_from_deg`")
        );
    }
}
