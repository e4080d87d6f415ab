//! The lines of arrows, from box to box.

use super::{
    arrangement::Arrangement,
    places::{NodeBox, Places},
    ways::{ArrowRouting, Routing},
};
use crate::figure::layout::count;
use contract::drawing::{Edge, Graph};
use std::{cmp::Ordering, collections::BTreeMap};

/// Largest distance between two arrows at one side of a box, in points.
const PORT: f64 = 4.0;
/// Largest offset at which an arrow between two boxes is made straight, in points.
const STRAIGHT: f64 = 6.0;
/// Length of the straight last piece of a curve, which the tip of an arrow covers.
const TIP: f64 = 4.5;

/// A place along the flow and across it.
pub(super) type Point = (f64, f64);

/// The line of an arrow.
#[derive(Debug, Clone)]
pub(super) struct Route {
    pub points: Vec<Point>,
    /// Whether its corners are rounded.
    pub cornered: bool,
    pub bypass: bool,
    pub label: String,
}

/// Side of a box where an arrow meets it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Side {
    /// Across the flow, on the side of the first lane.
    Low,
    /// Across the flow, on the side of the last lane.
    High,
    /// Along the flow, through the gap between two ranks, since other boxes stand beside it.
    Gap,
}

/// An end of an arrow at a box.
#[derive(Debug, Clone, Copy)]
struct End {
    node: usize,
    side: Side,
    /// Position that its line comes from or leads to, along the flow.
    toward: f64,
    /// Its order among others at one side: first lines that come down beside the stack, the nearest first; then lines
    /// of other stacks; then lines that go down beside it, the furthest first. In this order no two of them cross
    /// there. Among lines that pass whole stacks, the line to the nearest stack comes first behind the last rank, and
    /// last before the first rank.
    order: [f64; 3],
    /// Position where it meets the box, along the flow.
    at: f64,
}

/// The lines of all arrows, in the order of the graph.
pub(super) fn all(graph: &Graph, arrangement: &Arrangement, ways: &Routing, places: &Places) -> Vec<Route> {
    let plan = Plan::of(graph, arrangement, ways, places);
    let route = |(index, edge): (usize, &Edge)| {
        let (points, cornered) = match ways.ways[index] {
            ArrowRouting::Direct(rank) => (plan.direct(edge, rank), false),
            ArrowRouting::Beside { track, inside } => (plan.beside(index, track, inside), true),
            ArrowRouting::Over => (plan.over(index), true),
        };
        Route {
            points: without_repeats(points),
            cornered,
            bypass: edge.bypass,
            label: edge.label.clone(),
        }
    };
    graph.edges.iter().enumerate().map(route).collect()
}

/// Inputs of all lines: ends of arrows and tracks.
struct Plan<'a> {
    arrangement: &'a Arrangement,
    places: &'a Places,
    /// Both ends of each arrow.
    ends: Vec<[End; 2]>,
    /// Arrows past whole stacks: whether each passes behind the last rank or before the first, and its track. Arrows
    /// into the next stack have no entry.
    around: BTreeMap<usize, (bool, usize)>,
    /// Tracks in gaps between stacks, by arrow and gap.
    between: BTreeMap<(usize, usize), usize>,
}

impl<'a> Plan<'a> {
    fn of(graph: &'a Graph, arrangement: &'a Arrangement, ways: &Routing, places: &'a Places) -> Self {
        let mut plan = Self {
            arrangement,
            places,
            ends: Vec::new(),
            around: around(graph, arrangement, places),
            between: BTreeMap::new(),
        };
        plan.ends = (0..graph.edges.len())
            .map(|edge| plan.ends_of(edge, &graph.edges[edge], ways.ways[edge]))
            .collect();
        plan.spread(ways);
        plan.between = plan.gaps(ways);
        plan.straighten(ways);
        plan
    }

    fn ends_of(&self, index: usize, edge: &Edge, way: ArrowRouting) -> [End; 2] {
        let middle = |node: usize| self.places.boxes[node].along.middle();
        let (to_source, to_target) = match self.around.get(&index) {
            Some((true, _)) => (f64::INFINITY, f64::INFINITY),
            Some((false, _)) => (f64::NEG_INFINITY, f64::NEG_INFINITY),
            None => (middle(edge.to), middle(edge.from)),
        };
        let out = if way == ArrowRouting::Over {
            Side::High
        } else {
            Side::Low
        };
        let track = match self.around.get(&index) {
            Some((true, track)) => count(*track),
            Some((false, track)) => -count(*track),
            None => 0.0,
        };
        let end = |node, side, toward: f64, class| End {
            node,
            side: self.free(node, side),
            toward,
            order: if way == ArrowRouting::Over {
                [1.0, toward, track]
            } else {
                [class, -toward, 0.0]
            },
            at: middle(node),
        };
        [
            end(edge.from, out, to_source, 2.0),
            end(edge.to, Side::Low, to_target, 0.0),
        ]
    }

    /// The given side if no box stands between it and the track; otherwise the gap.
    fn free(&self, node: usize, side: Side) -> Side {
        let lane = self.arrangement.lanes[node];
        let beside = match side {
            Side::Low => 0..lane,
            _ => lane + 1..usize::MAX,
        };
        if self.arrangement.has(self.arrangement.ranks[node], &beside) {
            Side::Gap
        } else {
            side
        }
    }

    /// Spreads the arrows that meet one side of a box, in their order. An arrow that comes from a box at the same
    /// height keeps the middle, so that it is straight.
    fn spread(&mut self, ways: &Routing) {
        let mut sides: BTreeMap<(usize, Side), Vec<(usize, usize)>> = BTreeMap::new();
        for (edge, ends) in self.ends.iter().enumerate() {
            let is_direct = matches!(ways.ways[edge], ArrowRouting::Direct(_));
            for (which, end) in ends.iter().enumerate().filter(|(_, end)| end.side != Side::Gap) {
                if !is_direct {
                    sides.entry((end.node, end.side)).or_default().push((edge, which));
                }
            }
        }
        for ((node, _), mut ends) in sides {
            ends.sort_by(|one, other| {
                let order = |&(edge, which): &(usize, usize)| self.ends[edge][which].order;
                by_numbers(order(one), order(other)).then(one.cmp(other))
            });
            let along = self.places.boxes[node].along;
            let is_level = |&(edge, which): &(usize, usize)| {
                (self.ends[edge][which].toward - along.middle()).abs() < 0.5
            };
            let half = count(ends.len() - 1) / 2.0;
            let anchor = ends.iter().position(is_level).map_or(half, count);
            let most = anchor.max(count(ends.len() - 1) - anchor).max(0.5);
            let apart = PORT.min((along.length() / 2.0 - 2.0) / most);
            for (place, (edge, which)) in ends.into_iter().enumerate() {
                self.ends[edge][which].at += apart * (count(place) - anchor);
            }
        }
    }

    /// The track of each arrow in each gap between stacks that it runs along. Leaving arrows come first, which causes
    /// the fewest crossings.
    fn gaps(&self, ways: &Routing) -> BTreeMap<(usize, usize), usize> {
        let mut gaps: BTreeMap<usize, Vec<([f64; 3], usize)>> = BTreeMap::new();
        for (edge, ends) in self.ends.iter().enumerate() {
            if ways.ways[edge] != ArrowRouting::Over {
                continue;
            }
            let (first, last) = (
                self.arrangement.stack(ends[0].node),
                self.arrangement.stack(ends[1].node),
            );
            let (from, to) = (ends[0].at, ends[0].toward);
            let around = self.around.get(&edge).map_or(0.0, |(_, track)| count(*track));
            // The arrow that leads furthest is nearest, both among those that lead back and among those that lead on.
            let order = if to < from { to } else { -to };
            gaps.entry(first).or_default().push(([0.0, order, -around], edge));
            if last > first + 1 {
                let order = [1.0, around, -ends[1].at];
                gaps.entry(last - 1).or_default().push((order, edge));
            }
        }
        let mut tracks = BTreeMap::new();
        for (gap, mut edges) in gaps {
            edges.sort_by(|one, other| by_numbers(one.0, other.0).then(one.1.cmp(&other.1)));
            tracks.extend(
                edges
                    .into_iter()
                    .enumerate()
                    .map(|(track, (_, edge))| ((edge, gap), track)),
            );
        }
        tracks
    }

    /// Makes arrows into the next stack straight if the offset is small and no other arrow is in the way.
    fn straighten(&mut self, ways: &Routing) {
        let alone = |node: usize, side: Side| {
            let at = |end: &&End| end.node == node && end.side == side;
            self.ends.iter().flatten().filter(at).count() == 1
        };
        let mut straight = Vec::new();
        for (edge, [source, target]) in self.ends.iter().enumerate() {
            let is_candidate = ways.ways[edge] == ArrowRouting::Over
                && !self.around.contains_key(&edge)
                && source.side == Side::High
                && target.side == Side::Low
                && (source.at - target.at).abs() <= STRAIGHT;
            let meets = |node: usize, at: f64| {
                let span = self.places.boxes[node].along;
                !self.places.boxes[node].round && at > span.low + 1.0 && at < span.high - 1.0
            };
            if !is_candidate {
                continue;
            }
            if alone(target.node, Side::Low) && meets(target.node, source.at) {
                straight.push((edge, 1, source.at));
            } else if alone(source.node, Side::High) && meets(source.node, target.at) {
                straight.push((edge, 0, target.at));
            }
        }
        for (edge, which, at) in straight {
            self.ends[edge][which].at = at;
        }
    }

    /// A line along the flow, with a curve if it changes its lane.
    fn direct(&self, edge: &Edge, rank: usize) -> Vec<Point> {
        let (from, to) = (&self.places.boxes[edge.from], &self.places.boxes[edge.to]);
        let start = (from.along.high, from.across.middle());
        let end = (to.along.low, to.across.middle());
        if (start.1 - end.1).abs() < 0.01 {
            return vec![start, end];
        }
        // Boxes of the same rank may be longer than this one.
        let leave = (self.places.ranks[rank].high, start.1);
        let arrive = (self.places.ranks[rank + 1].low - TIP, end.1);
        let mut points = vec![start];
        points.extend(curve(leave, arrive));
        points.push(end);
        points
    }

    /// A line beside its stack, around the boxes in its way.
    fn beside(&self, edge: usize, track: usize, inside: bool) -> Vec<Point> {
        let stack = self.arrangement.stack(self.ends[edge][0].node);
        let across = self.places.beside(stack, track, inside);
        let (leave, arrive) = (self.leave(edge), self.arrive(edge));
        let mut points = leave.0;
        points.extend([(leave.1, across), (arrive.1, across)]);
        points.extend(arrive.0);
        points
    }

    /// A line through the gap into the next stack, or around the stacks between.
    fn over(&self, edge: usize) -> Vec<Point> {
        let [source, target] = self.ends[edge];
        let (first, last) = (
            self.arrangement.stack(source.node),
            self.arrangement.stack(target.node),
        );
        let gap = |gap: usize| {
            let track = self.between.get(&(edge, gap)).copied().unwrap_or(0);
            self.places.between(gap, track)
        };
        let (leave, arrive) = (self.leave(edge), self.arrive(edge));
        let mut points = leave.0;
        points.push((leave.1, gap(first)));
        if let Some((behind, track)) = self.around.get(&edge) {
            let along = self.places.around(*behind, *track);
            points.extend([(along, gap(first)), (along, gap(last - 1))]);
        }
        points.push((arrive.1, gap(last - 1)));
        points.extend(arrive.0);
        points
    }

    /// The first points of a line, and the position along the flow where it continues.
    fn leave(&self, edge: usize) -> (Vec<Point>, f64) {
        let end = self.ends[edge][0];
        let node = &self.places.boxes[end.node];
        if end.side != Side::Gap {
            return (vec![(end.at, rim(node, end))], end.at);
        }
        let along = self.places.gap_after(self.arrangement.ranks[end.node]);
        let across = node.across.middle();
        (vec![(node.along.high, across), (along, across)], along)
    }

    /// The last points of a line, and the position along the flow that it comes from.
    fn arrive(&self, edge: usize) -> (Vec<Point>, f64) {
        let end = self.ends[edge][1];
        let node = &self.places.boxes[end.node];
        if end.side != Side::Gap {
            return (vec![(end.at, rim(node, end))], end.at);
        }
        let along = self.places.gap_before(self.arrangement.ranks[end.node]);
        let across = node.across.middle();
        (vec![(along, across), (node.along.low, across)], along)
    }
}

fn by_numbers(one: [f64; 3], other: [f64; 3]) -> Ordering {
    let pairs = one.iter().zip(&other);
    let mut differing = pairs
        .map(|(one, other)| one.total_cmp(other))
        .filter(|order| order.is_ne());
    differing.next().unwrap_or(Ordering::Equal)
}

/// Position across the flow where a line meets a box or a circle.
fn rim(node: &NodeBox, end: End) -> f64 {
    let radius = node.across.length() / 2.0;
    let reach = if node.round {
        let off = end.at - node.along.middle();
        (radius * radius - off * off).max(0.0).sqrt()
    } else {
        radius
    };
    if end.side == Side::High {
        node.across.middle() + reach
    } else {
        node.across.middle() - reach
    }
}

/// Arrows that pass whole stacks, each with the shorter side and a track there; short arrows are nearest.
fn around(graph: &Graph, arrangement: &Arrangement, places: &Places) -> BTreeMap<usize, (bool, usize)> {
    let stacks = |edge: &Edge| (arrangement.stack(edge.from), arrangement.stack(edge.to));
    let mut passing: Vec<(usize, usize)> = Vec::new();
    for (index, edge) in graph.edges.iter().enumerate() {
        let (first, last) = stacks(edge);
        if last > first + 1 {
            passing.push((last - first, index));
        }
    }
    passing.sort_unstable();
    let (before, behind) = (places.around(false, 0), places.around(true, 0));
    let mut taken = [0, 0];
    let mut around = BTreeMap::new();
    for (_, index) in passing {
        let edge = &graph.edges[index];
        let ends = [edge.from, edge.to].map(|node| places.boxes[node].along.middle());
        let is_behind =
            ends.iter().map(|at| behind - at).sum::<f64>() <= ends.iter().map(|at| at - before).sum();
        let track = &mut taken[usize::from(is_behind)];
        around.insert(index, (is_behind, *track));
        *track += 1;
    }
    around
}

/// A curve that begins and ends along the flow.
fn curve(from: Point, to: Point) -> Vec<Point> {
    const PIECES: usize = 16;
    let middle = f64::midpoint(from.0, to.0);
    let at = |index: usize| {
        let t = count(index) / count(PIECES);
        let s = 1.0 - t;
        let weights = [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t];
        let mix = |values: [f64; 4]| {
            weights
                .iter()
                .zip(values)
                .map(|(weight, value)| weight * value)
                .sum()
        };
        (
            mix([from.0, middle, middle, to.0]),
            mix([from.1, from.1, to.1, to.1]),
        )
    };
    (0..=PIECES).map(at).collect()
}

fn without_repeats(mut points: Vec<Point>) -> Vec<Point> {
    points.dedup_by(|one, other| (one.0 - other.0).abs() + (one.1 - other.1).abs() < 0.01);
    points
}
