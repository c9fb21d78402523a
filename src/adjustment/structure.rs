//! Where the reduced normal matrix has entries, and the order in which its blocks are eliminated.
//!
//! A block holds the unknowns of a station, of a camera or of a kept point. Two blocks have an entry where a point, or a
//! distance, has to do with both. Blocks are eliminated by least degree (Tinney and Walker, 1967), and those that then have
//! the same rows are taken together (supernodes; Duff and Reid, 1983), so that the work is done on dense fronts.

use std::collections::BTreeSet;

use super::BundleProblem;

/// Stations that carry the datum of the factorisation.
const DATUM_STATIONS: usize = 8;

/// A front may always grow by so many rows where taking two together makes it wider.
const EXTRA_ROWS: f64 = 30.0;
/// What it costs to bring an entry of a front into memory, or to another front, in multiplications.
const COST_OF_ENTRY: f64 = 16.0;

/// The blocks of unknowns, where they meet, and the fronts.
#[derive(Clone, Debug, Default)]
pub(super) struct Structure {
    /// Where each block starts, and the end of the last.
    pub(super) starts: Vec<usize>,
    pub(super) columns: Vec<BlockColumn>,
    /// In the order of elimination: what a front is made of comes before it.
    pub(super) fronts: Vec<Front>,
    /// Fronts that have nothing to do with each other, those that others are made of first.
    pub(super) levels: Vec<Vec<usize>>,
    /// Of each block: its front.
    pub(super) front_of: Vec<usize>,
    /// Position of each block in the order of elimination.
    pub(super) position: Vec<usize>,
    /// Stations on which the datum of the factorisation rests: far from each other.
    pub(super) datum: Vec<usize>,
}

/// The rows of a block column, its own first, all others with higher numbers.
#[derive(Clone, Debug)]
pub(super) struct BlockColumn {
    pub(super) rows: Vec<u32>,
    /// Where each row block begins in the column, and its height.
    pub(super) offsets: Vec<usize>,
}

/// Blocks that are eliminated together.
#[derive(Clone, Debug)]
pub(super) struct Front {
    /// The blocks, by position: those that are eliminated here, then those that have to do with them.
    pub(super) blocks: Vec<usize>,
    /// Where each begins in the front, and the end.
    pub(super) starts: Vec<usize>,
    /// How many are eliminated here.
    pub(super) own: usize,
    /// The front that takes up what is left of this one.
    pub(super) parent: Option<usize>,
    /// The fronts that leave something for this one.
    pub(super) children: Vec<usize>,
    /// Of each row that is left: the row in the parent.
    pub(super) in_parent: Vec<usize>,
    /// The entries of the matrix that begin here: block column, and which of its rows.
    pub(super) entries: Vec<(usize, usize)>,
}

impl Front {
    /// Unknowns that are eliminated here.
    pub(super) fn width(&self) -> usize {
        self.starts[self.own]
    }

    /// All unknowns.
    pub(super) fn size(&self) -> usize {
        self.starts[self.blocks.len()]
    }

    /// Unknowns of one of its blocks.
    pub(super) fn height(&self, place: usize) -> usize {
        self.starts[place + 1] - self.starts[place]
    }

    /// Where some of its blocks stand, which are given by position.
    ///
    /// Cost: the logarithm of its blocks, for each of those asked for.
    pub(super) fn places_of(
        &self,
        structure: &Structure,
        blocks: impl Iterator<Item = usize>,
    ) -> Vec<usize> {
        let mut from = 0;
        let place = |block: usize| {
            let position = structure.position[block];
            from += self.blocks[from..].partition_point(|&b| structure.position[b] < position);
            from
        };
        blocks.map(place).collect()
    }

    /// Whether a block is eliminated here or earlier.
    pub(super) fn is_done_with(&self, structure: &Structure, block: usize) -> bool {
        structure.position[block] <= structure.position[self.blocks[self.own - 1]]
    }
}

impl Structure {
    /// Of blocks that start at these unknowns (the end last) and meet in these sets, each by rising numbers; those of `datum` meet as well.
    pub(super) fn new(
        starts: Vec<usize>,
        meetings: impl Iterator<Item = Vec<usize>>,
        datum: Vec<usize>,
    ) -> Self {
        let count = starts.len() - 1;
        let mut sets = Sets::new(count);
        for meeting in meetings.chain(std::iter::once(datum.clone())) {
            sets.join(&meeting);
        }
        let height = |block: usize| starts[block + 1] - starts[block];
        let columns = (0..count).map(|block| {
            let rows: Vec<u32> = (sets.of(block).filter(|&row| row >= block))
                .map(|row| row as u32)
                .collect();
            let mut offsets = vec![0];
            for &row in &rows {
                offsets.push(offsets[offsets.len() - 1] + height(row as usize));
            }
            BlockColumn { rows, offsets }
        });
        let columns: Vec<BlockColumn> = columns.collect();
        let (order, below) = sets.eliminated();
        let mut position = vec![0; count];
        for (at, &block) in order.iter().enumerate() {
            position[block] = at;
        }
        let mut fronts = fronts(&starts, &order, &position, below);
        let mut front_of = vec![0; count];
        for (index, front) in fronts.iter().enumerate() {
            for &block in &front.blocks[..front.own] {
                front_of[block] = index;
            }
        }
        for (block, column) in columns.iter().enumerate() {
            for (entry, &row) in column.rows.iter().enumerate() {
                let first = if position[row as usize] < position[block] {
                    row as usize
                } else {
                    block
                };
                fronts[front_of[first]].entries.push((block, entry));
            }
        }
        let mut levels: Vec<Vec<usize>> = Vec::new();
        let mut level_of = vec![0; fronts.len()];
        for (index, front) in fronts.iter().enumerate() {
            let level = front
                .children
                .iter()
                .map(|&child| level_of[child] + 1)
                .max();
            level_of[index] = level.unwrap_or(0);
            if levels.len() <= level_of[index] {
                levels.resize(level_of[index] + 1, Vec::new());
            }
            levels[level_of[index]].push(index);
        }
        Self {
            starts,
            columns,
            levels,
            fronts,
            front_of,
            position,
            datum,
        }
    }

    pub(super) fn blocks(&self) -> usize {
        self.columns.len()
    }

    /// The unknowns of a block.
    pub(super) fn range(&self, block: usize) -> std::ops::Range<usize> {
        self.starts[block]..self.starts[block + 1]
    }

    /// The block of an unknown.
    pub(super) fn block_of(&self, unknown: usize) -> usize {
        self.starts.partition_point(|start| *start <= unknown) - 1
    }
}

/// Symmetric sets of numbers, as bits.
struct Sets {
    words: usize,
    bits: Vec<u64>,
    count: usize,
}

impl Sets {
    fn new(count: usize) -> Self {
        let words = count.div_ceil(64);
        let mut sets = Self {
            words,
            bits: vec![0; words * count],
            count,
        };
        for k in 0..count {
            sets.join(&[k]);
        }
        sets
    }

    fn row(&self, k: usize) -> &[u64] {
        &self.bits[k * self.words..][..self.words]
    }

    /// Everything here meets everything here.
    fn join(&mut self, all: &[usize]) {
        for &k in all {
            for &other in all {
                self.bits[k * self.words + other / 64] |= 1 << (other % 64);
            }
        }
    }

    fn of(&self, k: usize) -> impl Iterator<Item = usize> {
        let words = self.row(k).iter().enumerate();
        words.flat_map(|(at, &word)| {
            let bits = std::iter::successors((word != 0).then_some(word), |word| {
                let rest = word & (word - 1);
                (rest != 0).then_some(rest)
            });
            bits.map(move |word| 64 * at + word.trailing_zeros() as usize)
        })
    }

    /// The order of least degree, and for each number of it what is left beside it when it goes.
    ///
    /// Cost: for each number, the square of those beside it over 64, and the count.
    fn eliminated(mut self) -> (Vec<usize>, Vec<Vec<usize>>) {
        let mut degrees: Vec<usize> = (0..self.count).map(|k| self.degree(k)).collect();
        let mut left: BTreeSet<(usize, usize)> =
            degrees.iter().copied().zip(0..self.count).collect();
        let (mut order, mut below) = (Vec::new(), vec![Vec::new(); self.count]);
        while let Some((_, next)) = left.pop_first() {
            let beside: Vec<usize> = self.of(next).filter(|&k| k != next).collect();
            let union = self.row(next).to_vec();
            for &k in &beside {
                let row = &mut self.bits[k * self.words..][..self.words];
                for (word, more) in row.iter_mut().zip(&union) {
                    *word |= more;
                }
                row[next / 64] &= !(1 << (next % 64));
                left.remove(&(degrees[k], k));
                degrees[k] = self.degree(k);
                left.insert((degrees[k], k));
            }
            order.push(next);
            below[next] = beside;
        }
        (order, below)
    }

    fn degree(&self, k: usize) -> usize {
        let bits: u32 = self.row(k).iter().map(|word| word.count_ones()).sum();
        bits as usize
    }
}

/// Blocks that are taken together while fronts are made.
struct Group {
    own: Vec<usize>,
    below: Vec<usize>,
    parent: Option<usize>,
}

/// The fronts of an elimination, in an order in which what makes up a front comes before it.
fn fronts(
    starts: &[usize],
    order: &[usize],
    position: &[usize],
    below: Vec<Vec<usize>>,
) -> Vec<Front> {
    let size =
        |blocks: &[usize]| -> usize { blocks.iter().map(|&b| starts[b + 1] - starts[b]).sum() };
    let first = |blocks: &[usize]| blocks.iter().copied().min_by_key(|&b| position[b]);
    // By position; a group's parent is the one of the first block that is left beside it.
    let mut groups: Vec<Option<Group>> = Vec::new();
    for &block in order {
        groups.push(Some(Group {
            own: vec![block],
            parent: first(&below[block]).map(|b| position[b]),
            below: below[block].clone(),
        }));
    }
    let mut taken_by: Vec<usize> = (0..groups.len()).collect();
    for at in 0..groups.len() {
        let Some(parent) = groups[at].as_ref().and_then(|group| group.parent) else {
            continue;
        };
        let (Some(child), Some(above)) = (&groups[at], &groups[parent]) else {
            continue;
        };
        let [own, left] = [&child.own, &child.below].map(|blocks| size(blocks) as f64);
        let whole = (size(&above.own) + size(&above.below)) as f64;
        // Together the child's own are eliminated over all rows of its parent, but nothing is left that must be handed on.
        let more = own * ((own + whole).powi(2) - (own + left).powi(2));
        let less = COST_OF_ENTRY * ((own + left).powi(2) + 2.0 * left.powi(2));
        if whole <= left + EXTRA_ROWS || more <= less {
            let mut own = child.own.clone();
            own.extend(&above.own);
            if let Some(above) = &mut groups[parent] {
                above.own = own;
            }
            groups[at] = None;
            taken_by[at] = parent;
        }
    }
    let mut number = vec![usize::MAX; groups.len()];
    let mut fronts: Vec<Front> = Vec::new();
    for (at, group) in groups.iter().enumerate() {
        let Some(group) = group else { continue };
        number[at] = fronts.len();
        let mut blocks = group.own.clone();
        let mut below = group.below.clone();
        blocks.sort_by_key(|&b| position[b]);
        below.sort_by_key(|&b| position[b]);
        let own = blocks.len();
        blocks.extend(below);
        let mut ends = vec![0];
        for &block in &blocks {
            ends.push(ends[ends.len() - 1] + starts[block + 1] - starts[block]);
        }
        fronts.push(Front {
            blocks,
            starts: ends,
            own,
            parent: group.parent,
            children: Vec::new(),
            in_parent: Vec::new(),
            entries: Vec::new(),
        });
    }
    for index in 0..fronts.len() {
        let Some(mut at) = fronts[index].parent else {
            continue;
        };
        while taken_by[at] != at {
            at = taken_by[at];
        }
        let parent = number[at];
        fronts[index].parent = Some(parent);
        fronts[index].in_parent = rows_in(&fronts[index], &fronts[parent]);
        fronts[parent].children.push(index);
    }
    fronts
}

/// The rows of a front that are what is left of another one.
fn rows_in(front: &Front, parent: &Front) -> Vec<usize> {
    let place = |block: usize| parent.blocks.iter().position(|&b| b == block).unwrap_or(0);
    let mut rows = Vec::new();
    for k in front.own..front.blocks.len() {
        let start = parent.starts[place(front.blocks[k])];
        rows.extend(start..start + front.starts[k + 1] - front.starts[k]);
    }
    rows
}

/// Stations far from each other, each the farthest from those before it.
pub(super) fn spread_stations(problem: &BundleProblem) -> Vec<usize> {
    let centres: Vec<_> = problem
        .stations
        .iter()
        .map(|station| station.pose.centre_in_world)
        .collect();
    if centres.is_empty() {
        return Vec::new();
    }
    let mut chosen = vec![0];
    let mut nearest: Vec<f64> = centres.iter().map(|c| (c - centres[0]).norm()).collect();
    while chosen.len() < DATUM_STATIONS.min(centres.len()) {
        let farthest = (0..centres.len())
            .filter(|k| !chosen.contains(k))
            .max_by(|&a, &b| nearest[a].total_cmp(&nearest[b]).then(b.cmp(&a)));
        let Some(next) = farthest else { break };
        chosen.push(next);
        for (distance, centre) in nearest.iter_mut().zip(&centres) {
            *distance = distance.min((centre - centres[next]).norm());
        }
    }
    chosen.sort_unstable();
    chosen
}
