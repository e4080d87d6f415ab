//! Maps of compressors and turbines as formulas.
//!
//! Compressors: the speed lines of M. Drela's TASOPT. Relative to the design point, with N the corrected speed,
//! m the corrected mass flow, p = (PR - 1) / (PR_D - 1), and u the position on the line, 0 on the spine,
//! positive towards choke and negative towards surge, which is -ln(1 - s) with TASOPT's s < 1:
//!
//! * `m = M^b + j s`, `p = M^(a b) - 2 M k u`, `s = 1 - exp(-u)`;
//! * M is N but where the inlet chokes near the design speed: `M = (N - A o(N)) / (1 - A o(1))`, with
//!   `o(N) = w ln(1 + exp((N - N_0) / w))`, which is 0 well below N_0 and N - N_0 well above;
//! * polytropic efficiency: `e = e_D [1 + g(N, s) - g(1, 0)]`, with
//!   `g = -l o'(N) - t s - c (u - s) - q (N - 1)^2`, where o' has a begin and a width of its own: losses
//!   grow above some speed, on both sides of the line and steeply towards choke, and far from the design speed.
//!
//! TASOPT has j = k, no choking and another form of the efficiency, whose constants leave deviations of 2 % in
//! the speed and of 2 points in the efficiency of pyCycle's high-bypass fan.
//!
//! Turbines are choked at all points of interest. Their corrected flow changes only with the relative corrected
//! speed, and their efficiency is
//! `e = e_D [1 + s (N - 1) - q (N - 1)^2 + r (PR / PR_D - 1)]`.
//!
//! The constants of turbines and of the fan's choking were fitted to operating points of pyCycle's example.

use super::number::{Number, exp, ln_1p, pow};

/// A term that sets in smoothly at some speed: `o(N) = w ln(1 + exp((N - N_0) / w))`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Onset {
    /// N_0.
    pub begin: f64,
    /// w.
    pub width: f64,
}

impl Onset {
    fn at<T: Number>(&self, speed: T) -> T {
        let x = (speed - self.begin) / self.width;
        // The same number without an overflow of the exponential for large x.
        let above = if x.re() > 0.0 { x } else { T::from(0.0) };
        (above + ln_1p(exp(-x.abs()))) * self.width
    }
}

/// The constants of a compressor's formulas.
#[derive(Debug, Clone, Copy)]
pub(super) struct CompressorShape {
    /// a.
    pub rise_of_flow: f64,
    /// b.
    pub flow_of_speed: f64,
    /// k.
    pub line_rise: f64,
    /// j.
    pub line_flow: f64,
    /// A and o.
    pub choking: (f64, Onset),
    pub losses: Losses,
}

/// The constants of a compressor's efficiency.
#[derive(Debug, Clone, Copy)]
pub(super) struct Losses {
    /// l and o'.
    pub speed: (f64, Onset),
    /// t.
    pub tilt: f64,
    /// c.
    pub bend: f64,
    /// q.
    pub off_speed: f64,
}

/// Flow, pressure rise and efficiency of a compressor, relative to its design point.
#[derive(Debug, Clone, Copy)]
pub(super) struct MapPoint<T> {
    /// Corrected mass flow.
    pub flow: T,
    /// (PR - 1) / (PR_D - 1).
    pub pressure_rise: T,
    /// Polytropic efficiency.
    pub efficiency: T,
}

impl CompressorShape {
    /// The map at a relative corrected speed and a position on its line.
    pub(super) fn at<T: Number>(&self, speed: T, line: T) -> MapPoint<T> {
        let (strength, onset) = &self.choking;
        let choked = (speed - onset.at(speed) * *strength) / (1.0 - strength * onset.at(1.0));
        let spine = pow(choked, self.flow_of_speed);
        let towards_choke = T::from(1.0) - exp(-line);
        MapPoint {
            flow: spine + towards_choke * self.line_flow,
            pressure_rise: pow(spine, self.rise_of_flow) - choked * line * (2.0 * self.line_rise),
            efficiency: T::from(1.0 + self.losses.at(1.0, 0.0, 0.0))
                - self.losses.at(speed, line, towards_choke),
        }
    }
}

impl Losses {
    /// -g, from N, u and s.
    fn at<T: Number>(&self, speed: T, line: T, towards_choke: T) -> T {
        let (strength, onset) = &self.speed;
        let off = speed - 1.0;
        onset.at(speed) * *strength
            + towards_choke * self.tilt
            + (line - towards_choke) * self.bend
            + off * off * self.off_speed
    }
}

/// The constants of a turbine's formulas.
#[derive(Debug, Clone, Copy)]
pub(super) struct TurbineShape {
    /// Change of the relative flow with the relative corrected speed.
    pub flow_by_speed: f64,
    /// s: change of the relative efficiency with the relative corrected speed.
    pub efficiency_by_speed: f64,
    /// q: bend of the relative efficiency over the relative corrected speed.
    pub bend: f64,
    /// r: change of the relative efficiency with the relative pressure ratio.
    pub efficiency_by_ratio: f64,
}

impl TurbineShape {
    /// Corrected flow relative to the design point's.
    pub(super) fn flow<T: Number>(&self, speed: T) -> T {
        (speed - 1.0) * self.flow_by_speed + 1.0
    }

    /// Efficiency relative to the design point's, at a corrected speed and a pressure ratio relative to it.
    pub(super) fn efficiency<T: Number>(&self, speed: T, ratio: T) -> T {
        let (faster, higher) = (speed - 1.0, ratio - 1.0);
        faster * (T::from(self.efficiency_by_speed) - faster * self.bend)
            + higher * self.efficiency_by_ratio
            + 1.0
    }
}
