//! The next settings of a search, from the results so far.

use super::{Method, Next, Point, Search, Tried};

/// Settings that a search proposed, with the results from which they follow, so that a longer list of results need not
/// start anew.
#[derive(Debug, Clone, Default)]
pub struct Proposals {
    tried: Vec<Tried>,
    points: Vec<Point>,
}

impl Proposals {
    /// The number of first results that are those of the earlier proposals.
    fn n_unchanged(&self, tried: &[Tried]) -> usize {
        let pairs = self.tried.iter().zip(tried);
        pairs.take_while(|(earlier, now)| earlier == now).count()
    }
}

impl Search {
    /// The next step, according to the results so far.
    #[must_use]
    pub fn next(&self, tried: &[Tried]) -> Next {
        self.next_after(tried, &mut Proposals::default())
    }

    /// [`Search::next`], which takes settings from earlier proposals of this search as long as the results before them
    /// are the same. Others are computed again, since a failed trial that was tried again may change them.
    #[must_use]
    pub fn next_after(&self, tried: &[Tried], earlier: &mut Proposals) -> Next {
        match &self.method {
            Method::CmaEs(options) => return self.adapted(options, tried),
            Method::Population(options) => return self.evolved(options, tried),
            _ => {}
        }
        let n_unchanged = earlier.n_unchanged(tried);
        let mut points: Vec<Point> = Vec::new();
        let next = loop {
            let (start, end) = (points.len(), self.end_of_generation(points.len()));
            match earlier.points.get(start..end).filter(|_| start <= n_unchanged) {
                Some(known) => points.extend_from_slice(known),
                None => points.extend(self.generation(&tried[..start], end)),
            }
            let known = tried
                .get(..points.len())
                .filter(|known| known.iter().map(|it| &it.point).eq(&points));
            if let Method::Halving(options) = &self.method {
                break self.halved(options, points.clone(), known);
            }
            let Some(known) = known.filter(|known| known.iter().all(|it| it.ended)) else {
                break Next::Try(points.clone(), vec![None; points.len()]);
            };
            if points.len() >= self.settings {
                break Next::Chosen(self.best(known, |_| true), vec![None; points.len()]);
            }
        };
        *earlier = Proposals {
            tried: tried.to_vec(),
            points,
        };
        next
    }

    /// Number of settings after the generation that begins with a place.
    pub(super) fn end_of_generation(&self, start: usize) -> usize {
        match &self.method {
            Method::TreeParzen(options) if start < options.startup => options.startup.min(self.settings),
            Method::TreeParzen(options) => (start + options.batch).min(self.settings),
            _ => self.settings,
        }
    }

    /// The settings up to a place that follow after all of `tried` have ended.
    pub(super) fn generation(&self, tried: &[Tried], end: usize) -> Vec<Point> {
        let mut points: Vec<Point> = tried.iter().map(|it| it.point.clone()).collect();
        for place in tried.len()..end {
            let point = self.propose(place, &points, tried);
            points.push(point);
        }
        points.split_off(tried.len())
    }
}
