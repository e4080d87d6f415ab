//! Positions of boxes and frames, along the flow and across it.

use super::{
    arrangement::{Arrangement, Flow, Group},
    ways::Routing,
};
use crate::figure::{
    axes::{TEXT, break_lines},
    layout::count,
    paint::text_width,
};
use contract::drawing::Graph;

/// Room around the text of a box, and the height of a line of it.
const PADDING: (f64, f64) = (4.0, 2.2);
const LINE: f64 = 8.8;
const NARROWEST: f64 = 22.0;
/// Diameter of the circle of a node whose label is a single character.
const CIRCLE: f64 = 12.0;
/// Room between two ranks: for a visible arrow, and for an arrow that changes its lane.
const GAP_DOWN: f64 = 8.0;
const GAP_RIGHT: f64 = 11.0;
const GAP_WIDE: f64 = 15.0;
const LANE_GAP: f64 = 11.0;
/// Between the nodes of a group and its frame, and the height of its name.
const FRAME: f64 = 5.0;
const NAME: f64 = 9.0;
/// From a box or a frame to the first track beside it, and from one track to the next.
const FIRST_TRACK: f64 = 6.5;
const TRACK: f64 = 5.0;
/// Distance between tracks if the track has a name.
const NAMED_TRACK: f64 = 9.0;
/// Distance between two stacks, without the tracks.
const STACK_GAP: f64 = 8.0;

/// A range of one coordinate, in points.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Span {
    pub low: f64,
    pub high: f64,
}

impl Span {
    fn around(middle: f64, length: f64) -> Self {
        Self {
            low: middle - length / 2.0,
            high: middle + length / 2.0,
        }
    }

    pub(super) fn middle(self) -> f64 {
        f64::midpoint(self.low, self.high)
    }

    pub(super) fn length(self) -> f64 {
        self.high - self.low
    }
}

/// A box, and the lines of its text.
#[derive(Debug, Clone)]
pub(super) struct NodeBox {
    pub along: Span,
    pub across: Span,
    pub round: bool,
    pub lines: Vec<String>,
}

/// A frame around the nodes of a group.
#[derive(Debug, Clone)]
pub(super) struct Frame {
    pub along: Span,
    pub across: Span,
    pub name: String,
}

/// Extent of a stack across the flow: its frames, and the lanes in them.
#[derive(Debug, Clone, Copy)]
struct StackSpan {
    frame: Span,
    lanes: Span,
}

/// Positions of everything but arrows.
#[derive(Debug)]
pub(super) struct Places {
    pub boxes: Vec<NodeBox>,
    pub frames: Vec<Frame>,
    /// Extent of each rank along the flow.
    pub ranks: Vec<Span>,
    stacks: Vec<StackSpan>,
    track: f64,
}

/// The size of a box by itself: along the flow, across it.
struct Size {
    along: f64,
    across: f64,
    round: bool,
    lines: Vec<String>,
}

impl Places {
    pub(super) fn of(graph: &Graph, arrangement: &Arrangement, ways: &Routing) -> Self {
        let sizes: Vec<Size> = graph
            .nodes
            .iter()
            .map(|node| size(&node.label, arrangement))
            .collect();
        let ranks = ranks(arrangement, ways, &sizes);
        let track = if ways.named { NAMED_TRACK } else { TRACK };
        let (stacks, lanes) = stacks(arrangement, ways, &sizes, track);
        let boxes: Vec<NodeBox> = sizes
            .into_iter()
            .enumerate()
            .map(|(node, size)| {
                let lane = lanes[arrangement.stack(node)][arrangement.lanes[node]];
                let rank = ranks[arrangement.ranks[node]];
                placed(size, arrangement.flow, rank, lane)
            })
            .collect();
        let frames = arrangement
            .groups
            .iter()
            .map(|group| frame(group, arrangement, &ranks, (&stacks, &boxes)))
            .collect();
        Self {
            boxes,
            frames,
            ranks,
            stacks,
            track,
        }
    }

    /// Across the flow, the place of a track beside a stack.
    pub(super) fn beside(&self, stack: usize, track: usize, inside: bool) -> f64 {
        let edge = if inside {
            self.stacks[stack].lanes.low
        } else {
            self.stacks[stack].frame.low
        };
        edge - FIRST_TRACK - self.track * count(track)
    }

    /// Across the flow, the place of a track in the gap after a stack.
    pub(super) fn between(&self, stack: usize, track: usize) -> f64 {
        self.stacks[stack].frame.high + STACK_GAP + self.track * count(track)
    }

    /// Along the flow, the place of a track before the first rank of all stacks, or behind the last.
    pub(super) fn around(&self, behind: bool, track: usize) -> f64 {
        let away = FIRST_TRACK + self.track * count(track);
        let ends = |pick: fn(Span) -> f64| {
            let frames = self.frames.iter().map(move |frame| pick(frame.along));
            self.ranks.iter().map(move |rank| pick(*rank)).chain(frames)
        };
        if behind {
            ends(|span| span.high).fold(f64::NEG_INFINITY, f64::max) + away
        } else {
            ends(|span| span.low).fold(f64::INFINITY, f64::min) - away
        }
    }

    /// Along the flow, the middle of the gap after a rank; shortly behind the rank if a stack ends there.
    pub(super) fn gap_after(&self, rank: usize) -> f64 {
        let high = self.ranks[rank].high;
        match self.ranks.get(rank + 1).filter(|next| next.low > high) {
            Some(next) => f64::midpoint(high, next.low),
            None => high + GAP_DOWN / 2.0,
        }
    }

    /// Along the flow, the middle of the gap before a rank; shortly before the rank if a stack begins there.
    pub(super) fn gap_before(&self, rank: usize) -> f64 {
        let low = self.ranks[rank].low;
        let before = rank.checked_sub(1).map(|before| self.ranks[before]);
        match before.filter(|before| before.high < low) {
            Some(before) => f64::midpoint(before.high, low),
            None => low - GAP_DOWN / 2.0,
        }
    }
}

fn size(label: &str, arrangement: &Arrangement) -> Size {
    let lines = break_lines(label, arrangement.text_width);
    let round = label.chars().count() == 1;
    let text = lines
        .iter()
        .map(|line| text_width(line, TEXT))
        .fold(0.0, f64::max);
    let width = (text + 2.0 * PADDING.0).max(NARROWEST);
    let height = LINE * count(lines.len().max(1)) + 2.0 * PADDING.1;
    let (along, across) = match arrangement.flow {
        _ if round => (CIRCLE, CIRCLE),
        Flow::Right => (width, height),
        Flow::Down => (height, width),
    };
    Size {
        along,
        across,
        round,
        lines,
    }
}

/// A box in its rank and lane: boxes of a rank, or of a lane if the flow leads down, are equally wide.
fn placed(size: Size, flow: Flow, rank: Span, lane: Span) -> NodeBox {
    let (along, across) = match flow {
        _ if size.round => (size.along, size.across),
        Flow::Right => (rank.length(), size.across),
        Flow::Down => (size.along, lane.length()),
    };
    NodeBox {
        along: Span::around(rank.middle(), along),
        across: Span::around(lane.middle(), across),
        round: size.round,
        lines: size.lines,
    }
}

/// Extents of the ranks one after the other, starting again with each stack.
fn ranks(arrangement: &Arrangement, ways: &Routing, sizes: &[Size]) -> Vec<Span> {
    let lead = match arrangement.flow {
        Flow::Right => FRAME,
        Flow::Down => FRAME + NAME,
    };
    let begins = |rank: usize| arrangement.groups.iter().any(|group| group.first == rank);
    let ends = |rank: usize| arrangement.groups.iter().any(|group| group.last == rank);
    let mut ranks = Vec::new();
    for stack in &arrangement.stacks {
        // The first ranks of all stacks stand at one height, whether in a frame or not.
        let mut at = if begins(stack.start) { 0.0 } else { lead };
        for rank in stack.clone() {
            at += if begins(rank) { lead } else { 0.0 };
            let length = arrangement.at(rank).map(|node| sizes[node].along);
            let length = length.fold(least(arrangement, rank), f64::max);
            ranks.push(Span {
                low: at,
                high: at + length,
            });
            at += length + if ends(rank) { FRAME } else { 0.0 };
            at += match arrangement.flow {
                _ if ways.wide.contains(&rank) => GAP_WIDE,
                Flow::Right => GAP_RIGHT,
                Flow::Down => GAP_DOWN,
            };
        }
    }
    ranks
}

/// Least extent of a rank: that of a line of text, so that circles and boxes stand at one height. In a flow to the
/// right, it is the extent of the name of a group that fills the rank.
fn least(arrangement: &Arrangement, rank: usize) -> f64 {
    if arrangement.flow == Flow::Down {
        return LINE + 2.0 * PADDING.1;
    }
    let is_here = |group: &&Group| (group.first, group.last) == (rank, rank);
    let here = arrangement.groups.iter().filter(is_here);
    here.map(|group| named(&group.name) - 2.0 * FRAME)
        .fold(0.0, f64::max)
}

/// Least length of a frame with this name.
fn named(name: &str) -> f64 {
    text_width(name, TEXT) + 8.0
}

/// Extent of each stack and of each of its lanes across the flow.
fn stacks(
    arrangement: &Arrangement,
    ways: &Routing,
    sizes: &[Size],
    track: f64,
) -> (Vec<StackSpan>, Vec<Vec<Span>>) {
    let room = |tracks: usize| {
        if tracks == 0 {
            0.0
        } else {
            FIRST_TRACK + track * count(tracks - 1)
        }
    };
    let (mut spans, mut all_lanes, mut at) = (Vec::new(), Vec::new(), 0.0);
    for (stack, ranks) in arrangement.stacks.iter().enumerate() {
        let framed = arrangement
            .groups
            .iter()
            .any(|group| ranks.contains(&group.first));
        let frame = if framed { FRAME } else { 0.0 };
        let name = if framed && arrangement.flow == Flow::Right {
            NAME
        } else {
            0.0
        };
        let (inside, outside) = ways.beside[stack];
        let low = at + room(outside);
        let lanes_low = low + frame + name + room(inside);
        let lanes_high = lanes(arrangement, stack, sizes, 0.0)
            .last()
            .map_or(lanes_low, |lane| lanes_low + lane.high);
        let held = arrangement
            .groups
            .iter()
            .filter(|group| ranks.contains(&group.first));
        let least = match arrangement.flow {
            Flow::Right => 0.0,
            Flow::Down => held.map(|group| named(&group.name)).fold(0.0, f64::max),
        };
        let missing = (least - (lanes_high + frame - low)).max(0.0);
        let (lanes_low, lanes_high) = (lanes_low + missing / 2.0, lanes_high + missing / 2.0);
        let high = lanes_high + frame + missing / 2.0;
        let lanes = lanes(arrangement, stack, sizes, lanes_low);
        spans.push(StackSpan {
            frame: Span { low, high },
            lanes: Span {
                low: lanes_low,
                high: lanes_high,
            },
        });
        all_lanes.push(lanes);
        at = high + 2.0 * STACK_GAP + track * count(ways.between[stack].saturating_sub(1));
    }
    (spans, all_lanes)
}

fn lanes(arrangement: &Arrangement, stack: usize, sizes: &[Size], low: f64) -> Vec<Span> {
    let nodes = || (0..sizes.len()).filter(|node| arrangement.stack(*node) == stack);
    let number = nodes().map(|node| arrangement.lanes[node] + 1).max().unwrap_or(0);
    let mut at = low;
    let mut spans = Vec::new();
    for lane in 0..number {
        let of_lane = nodes().filter(|node| arrangement.lanes[*node] == lane);
        let width = of_lane.map(|node| sizes[node].across).fold(0.0, f64::max);
        spans.push(Span {
            low: at,
            high: at + width,
        });
        at += width + LANE_GAP;
    }
    spans
}

fn frame(
    group: &Group,
    arrangement: &Arrangement,
    ranks: &[Span],
    (stacks, boxes): (&[StackSpan], &[NodeBox]),
) -> Frame {
    let name = match arrangement.flow {
        Flow::Right => 0.0,
        Flow::Down => NAME,
    };
    let along = Span {
        low: ranks[group.first].low - FRAME - name,
        high: ranks[group.last].high + FRAME,
    };
    let nodes = || group.nodes.iter().map(|node| boxes[*node].across);
    let own = Span {
        low: nodes().map(|span| span.low).fold(f64::INFINITY, f64::min) - FRAME,
        high: nodes().map(|span| span.high).fold(f64::NEG_INFINITY, f64::max) + FRAME,
    };
    let stack = stacks[arrangement.stack(group.nodes[0])].frame;
    Frame {
        along,
        across: if group.alone { stack } else { own },
        name: group.name.clone(),
    }
}
