//! The kernels that build trees of points, stated serially: the specification of a device's.

use alloc::vec::Vec;
use core::convert::Infallible;
use core::mem;
use core::ops::Range;

use crate::arithmetic::{Strict, exponent, ordered_bits, snap};
use crate::build::lockstep::Inspect;
use crate::build::schedule::Executor;
use crate::kernel::{PointBuffer, PointBuilder, PointCounter, PointKernel};
use crate::layout::{
    POINT_CHUNK, PointBuild, PointCounters, PointExtent, PointRecord, PointSplit, SMALL_HEIGHT,
};
use crate::points::distance::Unit;
use crate::points::tree::{BLOCK, PointNode, from_ordered, height};

/// Runs the kernels one chunk or node after the other.
#[derive(Debug)]
pub struct Reference<'a> {
    /// Coordinates, point by point.
    input: &'a [f32],
    inputs: PointBuild,
    counters: PointCounters,
    measures: Vec<[u32; 2]>,
    chunk_places: Vec<u32>,
    records: Vec<PointRecord>,
    next_records: Vec<PointRecord>,
    extents: Vec<PointExtent>,
    splits: Vec<PointSplit>,
    digits: Vec<[u32; 256]>,
    sides: Vec<[u32; 2]>,
    sides_before: Vec<[u32; 2]>,
    nodes: Vec<PointNode>,
    points: Vec<[f32; 4]>,
    indices: Vec<u32>,
}

impl<'a> Reference<'a> {
    /// Over points whose coordinates stand one after the other.
    pub fn new(input: &'a [f32], inputs: PointBuild) -> Reference<'a> {
        Reference {
            input,
            inputs,
            counters: PointCounters::at_start(inputs.given),
            measures: Vec::new(),
            chunk_places: Vec::new(),
            records: Vec::new(),
            next_records: Vec::new(),
            extents: Vec::new(),
            splits: Vec::new(),
            digits: Vec::new(),
            sides: Vec::new(),
            sides_before: Vec::new(),
            nodes: Vec::new(),
            points: Vec::new(),
            indices: Vec::new(),
        }
    }

    /// Nodes, points and indices of the finished tree.
    pub fn tree(&self) -> (&[PointNode], &[[f32; 4]], &[u32]) {
        (&self.nodes, &self.points, &self.indices)
    }

    fn count(&self, counter: PointCounter) -> usize {
        self.counters[counter] as usize
    }

    fn blocks(&self) -> u32 {
        self.counters[PointCounter::Kept].div_ceil(BLOCK as u32)
    }

    /// The coordinates of the points given of a chunk.
    fn given(&self, chunk: usize) -> impl Iterator<Item = (usize, &'a [f32])> + use<'a> {
        let (dimensions, size) = (self.inputs.dimensions as usize, POINT_CHUNK as usize);
        self.input.chunks(dimensions).enumerate().skip(chunk * size).take(size)
    }

    /// The places of the points of a chunk.
    fn places(&self, chunk: usize) -> Range<usize> {
        let first = chunk * POINT_CHUNK as usize;
        first..self.records.len().min(first + POINT_CHUNK as usize)
    }

    /// The chunks of a large node.
    fn chunks(&self, node: usize) -> Range<usize> {
        let shift = self.counters[PointCounter::Height] - SMALL_HEIGHT;
        let first = node << shift;
        first..self.count(PointCounter::Chunks).min(first + (1 << shift))
    }

    /// The large node of a chunk.
    fn node_of(&self, chunk: usize) -> usize {
        chunk >> (self.counters[PointCounter::Height] - SMALL_HEIGHT)
    }

    fn measure_points(&mut self) {
        self.measures.clear();
        for chunk in 0..self.count(PointCounter::InputChunks) {
            let mut measured = [0, 0];
            for (_, point) in self.given(chunk).filter(|(_, point)| is_kept(point)) {
                measured[0] += 1;
                for x in point {
                    measured[1] = measured[1].max(x.abs().to_bits());
                }
            }
            self.measures.push(measured);
        }
    }

    fn scan_points(&mut self) {
        self.chunk_places.clear();
        let (mut kept, mut greatest) = (0, 0);
        for measured in &self.measures {
            self.chunk_places.push(kept);
            kept += measured[0];
            greatest = greatest.max(measured[1]);
        }
        let height = height(kept as usize);
        let chunks = kept.div_ceil(POINT_CHUNK);
        let is_large = height > SMALL_HEIGHT;
        let unit = exponent(f32::from_bits(greatest)).clamp(-126, 126);
        let nodes = kept.div_ceil(BLOCK as u32).saturating_sub(1);
        let counters = &mut self.counters;
        counters[PointCounter::Kept] = kept;
        counters[PointCounter::Chunks] = chunks;
        counters[PointCounter::ActiveChunks] = if is_large { chunks } else { 0 };
        counters[PointCounter::Large] = u32::from(is_large);
        counters[PointCounter::Height] = height;
        counters[PointCounter::RootHeight] = height;
        counters[PointCounter::Unit] = (unit + 127).cast_unsigned();
        counters[PointCounter::Nodes] = nodes;
        self.nodes.clear();
        self.nodes.resize(nodes as usize, PointNode { plane: 0.0, axis: 0 });
    }

    fn gather_points(&mut self) {
        let exponent = self.counters[PointCounter::Unit].cast_signed() - 127;
        let unit = Unit::of_exponent(exponent);
        self.records.clear();
        for chunk in 0..self.count(PointCounter::InputChunks) {
            for (index, point) in self.given(chunk).filter(|(_, point)| is_kept(point)) {
                let mut bits = [ordered_bits(0.0); 4];
                for (own, &x) in bits.iter_mut().zip(point) {
                    *own = ordered_bits(unit.scaled::<Strict>(x));
                }
                let [x, y, z, w] = bits;
                self.records.push(PointRecord { x, y, z, w, point: index as u32 });
            }
        }
    }

    fn point_extents(&mut self) {
        self.extents.clear();
        for chunk in 0..self.count(PointCounter::ActiveChunks) {
            self.extents.push(extent_of(&self.records[self.places(chunk)]));
        }
    }

    fn choose_axes(&mut self) {
        self.splits.clear();
        let height = self.counters[PointCounter::Height];
        for node in 0..self.count(PointCounter::Large) {
            let split = if middle_of(node as u32, height) >= self.blocks() {
                PointSplit { axis: PointSplit::UNDIVIDED, bits: 0, rank: 0, known: 0 }
            } else {
                let extents = self.extents.get(self.chunks(node)).unwrap_or_default();
                let all = extents.iter().fold(PointExtent::NONE, |all, one| union(&all, one));
                let axis = self.axis(node as u32, height, &all);
                PointSplit { axis, bits: 0, rank: (BLOCK as u32) << (height - 1), known: 0 }
            };
            self.splits.push(split);
        }
    }

    /// The axis of a node whose points reach so far.
    fn axis(&self, node: u32, height: u32, extent: &PointExtent) -> u32 {
        if self.inputs.widest == 0 {
            let root = self.counters[PointCounter::RootHeight];
            let divided = |&above: &u32| middle_of(node >> (above - height), above) < self.blocks();
            let level = (height + 1..=root).filter(divided).count() as u32;
            return level % self.inputs.dimensions;
        }
        let (mut best, mut most) = (0, -1.0);
        for axis in 0..self.inputs.dimensions {
            let [lower, upper] = [extent.lower, extent.upper].map(|side| side[axis as usize]);
            let reach = snap(from_ordered(upper) - from_ordered(lower));
            if reach > most {
                (best, most) = (axis, reach);
            }
        }
        best
    }

    fn count_digits(&mut self) {
        self.digits.clear();
        for chunk in 0..self.count(PointCounter::ActiveChunks) {
            let split = self.splits[self.node_of(chunk)];
            let mut digits = [0; 256];
            if split.axis != PointSplit::UNDIVIDED {
                let unknown = u32::MAX >> split.known;
                for record in &self.records[self.places(chunk)] {
                    let bits = record.along(split.axis);
                    if bits & !unknown == split.bits {
                        digits[(bits >> (24 - split.known)) as usize & 255] += 1;
                    }
                }
            }
            self.digits.push(digits);
        }
    }

    fn pick_digits(&mut self) {
        for node in 0..self.splits.len() {
            let chunks = self.chunks(node);
            let split = &mut self.splits[node];
            if split.axis == PointSplit::UNDIVIDED {
                continue;
            }
            for digit in 0..256 {
                let own: u32 =
                    self.digits[chunks.clone()].iter().map(|digits| digits[digit as usize]).sum();
                if split.rank < own {
                    split.bits |= digit << (24 - split.known);
                    split.known += 8;
                    break;
                }
                split.rank -= own;
            }
        }
    }

    fn count_sides(&mut self) {
        self.sides.clear();
        for chunk in 0..self.count(PointCounter::ActiveChunks) {
            let split = self.splits[self.node_of(chunk)];
            let mut sides = [0; 2];
            if split.axis != PointSplit::UNDIVIDED {
                for record in &self.records[self.places(chunk)] {
                    let bits = record.along(split.axis);
                    sides[0] += u32::from(bits < split.bits);
                    sides[1] += u32::from(bits == split.bits);
                }
            }
            self.sides.push(sides);
        }
    }

    fn place_sides(&mut self) {
        self.sides_before.clear();
        let height = self.counters[PointCounter::Height];
        for node in 0..self.splits.len() {
            let mut before = [0; 2];
            for chunk in self.chunks(node) {
                self.sides_before.push(before);
                let sides = self.sides[chunk];
                before = [before[0] + sides[0], before[1] + sides[1]];
            }
            let split = self.splits[node];
            if split.axis != PointSplit::UNDIVIDED {
                let plane = from_ordered(split.bits);
                self.nodes[middle_of(node as u32, height) as usize - 1] =
                    PointNode { plane, axis: split.axis };
            }
        }
    }

    fn scatter_points(&mut self) {
        self.next_records.clone_from(&self.records);
        let height = self.counters[PointCounter::Height];
        for chunk in 0..self.count(PointCounter::ActiveChunks) {
            let node = self.node_of(chunk);
            let split = self.splits[node];
            if split.axis == PointSplit::UNDIVIDED {
                continue;
            }
            let start = (node << height) * BLOCK;
            let middle = middle_of(node as u32, height) as usize * BLOCK;
            let [mut below, mut on_plane] = self.sides_before[chunk];
            for place in self.places(chunk) {
                let record = self.records[place];
                let bits = record.along(split.axis);
                let lefts = (below + on_plane.min(split.rank)) as usize;
                let is_left = bits < split.bits || (bits == split.bits && on_plane < split.rank);
                let moved = if is_left { start + lefts } else { middle + (place - start) - lefts };
                self.next_records[moved] = record;
                below += u32::from(bits < split.bits);
                on_plane += u32::from(bits == split.bits);
            }
        }
    }

    fn next_height(&mut self) {
        if self.counters[PointCounter::Large] == 0 {
            return;
        }
        let height = self.counters[PointCounter::Height] - 1;
        let nodes = self.blocks().div_ceil(1 << height);
        let is_large = height > SMALL_HEIGHT;
        let counters = &mut self.counters;
        counters[PointCounter::ActiveChunks] =
            if is_large { counters[PointCounter::Chunks] } else { 0 };
        counters[PointCounter::Large] = if is_large { nodes } else { 0 };
        counters[PointCounter::Height] = height;
    }

    fn build_small_points(&mut self) {
        self.points.clear();
        self.indices.clear();
        let top = self.counters[PointCounter::RootHeight].min(SMALL_HEIGHT);
        let mut records = mem::take(&mut self.records);
        for (chunk, own) in records.chunks_mut(POINT_CHUNK as usize).enumerate() {
            for height in (1..=top).rev() {
                let first = (chunk << (SMALL_HEIGHT - height)) as u32;
                for (node, points) in (first..).zip(own.chunks_mut(BLOCK << height)) {
                    let half = BLOCK << (height - 1);
                    if points.len() <= half {
                        continue;
                    }
                    let axis = self.axis(node, height, &extent_of(points));
                    points.sort_unstable_by_key(|record| (record.along(axis), record.point));
                    let plane = from_ordered(points[half].along(axis));
                    self.nodes[middle_of(node, height) as usize - 1] = PointNode { plane, axis };
                }
            }
            for block in own.chunks_mut(BLOCK) {
                block.sort_unstable_by_key(|record| record.point);
                for record in &*block {
                    let bits = [record.x, record.y, record.z, record.w];
                    self.points.push(bits.map(from_ordered));
                    self.indices.push(record.point);
                }
            }
        }
        self.records = records;
    }
}

/// The block at which the node of this height with this number is divided.
fn middle_of(node: u32, height: u32) -> u32 {
    (node << height) + (1 << (height - 1))
}

fn is_kept(point: &[f32]) -> bool {
    point.iter().all(|x| x.is_finite())
}

fn union(a: &PointExtent, b: &PointExtent) -> PointExtent {
    let mut all = *a;
    for axis in 0..4 {
        all.lower[axis] = a.lower[axis].min(b.lower[axis]);
        all.upper[axis] = a.upper[axis].max(b.upper[axis]);
    }
    all
}

fn extent_of(records: &[PointRecord]) -> PointExtent {
    records.iter().fold(PointExtent::NONE, |all, record| {
        let bits = [record.x, record.y, record.z, record.w];
        union(&all, &PointExtent { lower: bits, upper: bits })
    })
}

impl Executor<PointBuilder> for Reference<'_> {
    type Error = Infallible;

    fn dispatch(&mut self, kernel: PointKernel) -> Result<(), Infallible> {
        match kernel {
            PointKernel::MeasurePoints => self.measure_points(),
            PointKernel::ScanPoints => self.scan_points(),
            PointKernel::GatherPoints => self.gather_points(),
            PointKernel::PointExtents => self.point_extents(),
            PointKernel::ChooseAxes => self.choose_axes(),
            PointKernel::CountDigits => self.count_digits(),
            PointKernel::PickDigits => self.pick_digits(),
            PointKernel::CountSides => self.count_sides(),
            PointKernel::PlaceSides => self.place_sides(),
            PointKernel::ScatterPoints => self.scatter_points(),
            PointKernel::NextHeight => self.next_height(),
            PointKernel::BuildSmallPoints => self.build_small_points(),
        }
        Ok(())
    }

    fn swap(&mut self, _: PointBuffer, _: PointBuffer) -> Result<(), Infallible> {
        mem::swap(&mut self.records, &mut self.next_records);
        Ok(())
    }

    fn pending(&mut self, counter: PointCounter, _rounds: u32) -> Result<bool, Infallible> {
        Ok(self.counters[counter] > 0)
    }
}

impl Inspect<PointBuilder> for Reference<'_> {
    fn live(&mut self, buffer: PointBuffer) -> Result<Vec<u8>, Infallible> {
        let bytes: &[u8] = match buffer {
            PointBuffer::Counters => bytemuck::bytes_of(&self.counters),
            PointBuffer::Input => &[],
            PointBuffer::ChunkMeasures => bytemuck::cast_slice(&self.measures),
            PointBuffer::ChunkPlaces => bytemuck::cast_slice(&self.chunk_places),
            PointBuffer::Records => bytemuck::cast_slice(&self.records),
            PointBuffer::NextRecords => bytemuck::cast_slice(&self.next_records),
            PointBuffer::ChunkExtents => bytemuck::cast_slice(&self.extents),
            PointBuffer::Splits => bytemuck::cast_slice(&self.splits),
            PointBuffer::ChunkDigits => bytemuck::cast_slice(&self.digits),
            PointBuffer::ChunkSides => bytemuck::cast_slice(&self.sides),
            PointBuffer::SidesBefore => bytemuck::cast_slice(&self.sides_before),
            PointBuffer::Nodes => bytemuck::cast_slice(&self.nodes),
            PointBuffer::Points => bytemuck::cast_slice(&self.points),
            PointBuffer::Indices => bytemuck::cast_slice(&self.indices),
        };
        Ok(bytes.to_vec())
    }
}
