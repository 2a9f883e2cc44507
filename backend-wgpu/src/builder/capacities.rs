//! The capacity of each list, chosen before its length is known.

use splitplane_core::build::middle::{Region, hand_over_limit};
use splitplane_core::config::{BuildConfig, CHUNK, Planes};
use splitplane_core::kernel::{Buffer, Counter, Overflow, subtree_slots};
use splitplane_core::layout::{Counters, Parameters};

use super::middle_stage::MiddleStage;
use crate::device::halves::{self, binding_limit, halves_limit};
use crate::error::GpuError;

/// Capacities, in elements, of everything that grows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Capacities {
    pub triangles: u32,
    /// Bytes of the mesh.
    pub input_bytes: u64,
    /// Whether the longest lists are bound by halves, since one binding is too small for one of them.
    pub by_halves: bool,
    pub chunks: u32,
    /// Chunks that were too many for what the device can bind; 0 if there were none.
    pub too_many_chunks: u32,
    /// Whether planes are found by bins: chunks then have bins.
    pub binned: bool,
    /// Whether the levels hand nodes over to the middle stage.
    pub middle: bool,
    pub nodes: u32,
    pub references: u32,
    pub small_roots: u32,
    pub small_references: u32,
    /// Slots for subtrees that are kept; others are built twice. A root has [`subtree_slots`] of them.
    pub subtrees: u32,
    /// References of the pool of the middle stage, and nodes and leaves of its regions.
    pub middle_references: u32,
    pub middle_nodes: u32,
    pub middle_leaves: u32,
    pub top_nodes: u32,
    pub levels: u32,
    pub tree_nodes: u32,
    pub leaf_references: u32,
}

/// References of a triangle that the pool of the middle stage holds at the least: with less it is not tried.
const LEAST_POOL: u64 = 6;

/// `count * numerator / denominator + slack`, at most `u32::MAX`.
fn share(count: u32, numerator: u64, denominator: u64, slack: u64) -> u32 {
    u32::try_from(u64::from(count) * numerator / denominator + slack).unwrap_or(u32::MAX)
}

impl Capacities {
    /// Capacities that suffice for nearly all scenes. The greatest per triangle seen over scanned,
    /// built and random scenes: 1.23 active references, 2.5 references of small roots, 1 small root
    /// for 17 triangles, 1 top node for 6, 0.7 nodes, 3.1 references of the tree; with leaves of one triangle 4.5 nodes and
    /// 5.7 references.
    pub(crate) fn estimate(triangles: u32, config: &BuildConfig) -> Capacities {
        let [nodes, references] = if config.block_width < 8 { [5, 13] } else { [1, 7] };
        Capacities {
            triangles,
            input_bytes: 0,
            by_halves: false,
            chunks: 0,
            too_many_chunks: 0,
            binned: config.preset().planes() == Some(Planes::Binned),
            middle: false,
            nodes: 0,
            references: share(triangles, 3, 2, 4096),
            small_roots: share(triangles, 1, 12, 1024),
            small_references: share(triangles, 3, 1, 4096),
            subtrees: share(triangles, 1, 12, 1024)
                .saturating_mul(subtree_slots(config.block_width)),
            middle_references: 0,
            middle_nodes: 0,
            middle_leaves: 0,
            top_nodes: share(triangles, 1, 4, 4096),
            levels: config.max_depth + 2,
            tree_nodes: share(triangles, nodes, 1, 8192),
            leaf_references: share(triangles, references, 2, 8192),
        }
        .with_bounds(config)
    }

    /// Capacities that no scene outgrows before a cap of the configuration binds, except the tree
    /// itself.
    pub(crate) fn roomy(triangles: u32, config: &BuildConfig) -> Capacities {
        let references = config.reference_cap(triangles);
        Capacities {
            references,
            small_roots: config.node_cap(triangles),
            small_references: references,
            top_nodes: config.node_cap(triangles).saturating_add(16),
            tree_nodes: references.saturating_mul(2),
            leaf_references: references.saturating_mul(2),
            ..Capacities::estimate(triangles, config)
        }
        .with_bounds(config)
    }

    /// The same with a middle stage, if there is one for the configuration's planes: what a first build estimates.
    #[must_use]
    pub(crate) fn with_middle_stage(self) -> Capacities {
        if self.binned {
            return self;
        }
        // The greatest seen over scanned and built scenes: 1.2 references of a triangle are handed over, in a node for 250
        // triangles and few others.
        let handed = share(self.triangles, 3, 2, 4096);
        let regions = Region::start(handed, share(self.triangles, 1, 100, 256));
        Capacities {
            middle: true,
            middle_references: share(self.triangles, 10, 1, 16_384),
            middle_nodes: regions.nodes.saturating_add(1),
            middle_leaves: regions.leaves,
            ..self
        }
    }

    /// With a middle stage that has room whatever scenes do, short of its own rules and of what one binding holds.
    #[must_use]
    pub(crate) fn with_room_for_any_growth(self, limits: &wgpu::Limits) -> Capacities {
        let (bytes, _) = binding_limit(limits);
        let most = |buffer: Buffer, room: u32, times: u32| {
            let bound = u32::try_from(bytes / buffer.element_size() as u64).unwrap_or(u32::MAX);
            room.saturating_mul(times).saturating_add(1 << 16).min(bound.max(room))
        };
        Capacities {
            middle_references: most(
                Buffer::MiddleReferences,
                self.middle_references.max(3 << 18),
                4,
            ),
            middle_nodes: most(Buffer::MiddleNodes, self.middle_nodes, 2),
            middle_leaves: most(Buffer::MiddleLeaves, self.middle_leaves, 2),
            ..self
        }
    }

    /// Why a device with these limits has no middle stage: it works on whole lists in single bindings.
    pub(crate) fn too_long_for_middle_stage(&self, limits: &wgpu::Limits) -> Option<MiddleStage> {
        let (allowed, _) = binding_limit(limits);
        let with_stage = Capacities { middle: true, ..*self };
        let own = [Buffer::MiddleReferences, Buffer::MiddleNodes, Buffer::MiddleLeaves];
        // Where one list is bound by halves all of its kind are, those that one binding would hold too.
        let of_levels = LONG.into_iter().filter(|_| self.by_halves);
        let bytes = |buffer: &Buffer| with_stage.bytes_of(*buffer);
        let list = own.into_iter().chain(of_levels).max_by_key(bytes)?;
        let needed = bytes(&list);
        (self.by_halves || needed > allowed).then_some(MiddleStage::TooLong {
            list,
            needed,
            allowed,
        })
    }

    /// The same without a middle stage.
    #[must_use]
    pub(crate) fn without_middle_stage(self) -> Capacities {
        Capacities { middle: false, ..self }
    }

    /// Large nodes have more than T references each, and a node's last chunk alone may be short: that
    /// bounds both lists.
    fn with_bounds(mut self, config: &BuildConfig) -> Capacities {
        self.nodes = self.references / (config.small_node_limit() + 1) + 1;
        let chunks = (self.references / CHUNK).saturating_add(self.nodes);
        self.chunks = chunks.max(self.triangles.div_ceil(CHUNK)).max(1);
        self
    }

    /// Capacities for what a build turned out to need, and twice the capacity of what overflowed, since it stopped
    /// there; no more than a device can bind, unless it needs more.
    #[must_use]
    pub(crate) fn grown(
        mut self,
        counters: &Counters,
        config: &BuildConfig,
        limits: &wgpu::Limits,
    ) -> Capacities {
        let overflow = counters[Counter::Overflow];
        let grow = |room: &mut u32, bit: Overflow, needed: u32| {
            if overflow & bit as u32 != 0 {
                let buffer = bounded_by(bit);
                let (bytes, _) =
                    if is_long(buffer) { halves_limit(limits) } else { binding_limit(limits) };
                let most = u32::try_from(bytes / buffer.element_size() as u64).unwrap_or(u32::MAX);
                *room = room.saturating_mul(2).min(most).max(needed).max(room.saturating_add(1));
            }
        };
        // Active and next may have changed places: the greater one overflowed.
        let references = counters[Counter::NextReferences].max(counters[Counter::ActiveReferences]);
        grow(&mut self.references, Overflow::References, references);
        grow(&mut self.references, Overflow::Nodes, 0);
        grow(&mut self.references, Overflow::Chunks, 0);
        grow(&mut self.small_roots, Overflow::SmallRoots, counters[Counter::SmallRoots]);
        let small_references = counters[Counter::SmallReferences];
        grow(&mut self.small_references, Overflow::SmallReferences, small_references);
        grow(&mut self.top_nodes, Overflow::TopNodes, counters[Counter::TopNodes]);
        grow(&mut self.levels, Overflow::Levels, counters[Counter::Levels]);
        grow(&mut self.tree_nodes, Overflow::TreeNodes, counters[Counter::Nodes]);
        let leaf_references = counters[Counter::LeafReferences];
        grow(&mut self.leaf_references, Overflow::LeafReferences, leaf_references);
        if overflow & Overflow::MiddleRegions as u32 != 0 {
            self.middle_references = self.middle_references.saturating_mul(2).max(16_384);
            let (handed, roots) =
                (counters[Counter::SmallReferences], counters[Counter::MiddleRoots]);
            let regions = Region::start(handed, roots);
            self.middle_nodes = self.middle_nodes.max(regions.nodes.saturating_add(1));
            self.middle_leaves = self.middle_leaves.max(regions.leaves);
        }
        // There is space for all chunks of this many references, unless no device can bind it.
        if overflow & Overflow::Chunks as u32 != 0 {
            // Active and next may have changed places.
            self.too_many_chunks = counters[Counter::NextChunks].max(counters[Counter::Chunks]);
        }
        self.with_bounds(config)
    }

    /// The greater capacity of each kind, for a build as `self` has it.
    #[must_use]
    pub(crate) fn union(self, other: Capacities) -> Capacities {
        Capacities {
            triangles: self.triangles.max(other.triangles),
            input_bytes: self.input_bytes,
            by_halves: self.by_halves,
            chunks: self.chunks.max(other.chunks),
            too_many_chunks: self.too_many_chunks,
            binned: self.binned,
            middle: self.middle,
            nodes: self.nodes.max(other.nodes),
            references: self.references.max(other.references),
            small_roots: self.small_roots.max(other.small_roots),
            small_references: self.small_references.max(other.small_references),
            subtrees: self.subtrees.max(other.subtrees),
            middle_references: self.middle_references.max(other.middle_references),
            middle_nodes: self.middle_nodes.max(other.middle_nodes),
            middle_leaves: self.middle_leaves.max(other.middle_leaves),
            top_nodes: self.top_nodes.max(other.top_nodes),
            levels: self.levels.max(other.levels),
            tree_nodes: self.tree_nodes.max(other.tree_nodes),
            leaf_references: self.leaf_references.max(other.leaf_references),
        }
    }

    /// Elements of a buffer.
    pub(crate) fn of(&self, buffer: Buffer) -> u32 {
        match buffer {
            Buffer::Input | Buffer::Counters => 1,
            Buffer::Triangles => self.triangles,
            Buffer::References | Buffer::NextReferences => self.references,
            Buffer::SmallReferences => self.small_references,
            Buffer::ActiveNodes | Buffer::NextNodes | Buffer::NodeBounds | Buffer::Decisions => {
                self.nodes
            }
            Buffer::Chunks
            | Buffer::ChunkCounts
            | Buffer::ChunkBounds
            | Buffer::ChunkState
            | Buffer::ReferenceSides => self.chunks,
            Buffer::ChunkBins if self.binned => self.chunks,
            Buffer::ChunkBins => 0,
            Buffer::TopNodes | Buffer::TopSizes | Buffer::TopAddresses => self.top_nodes,
            // One word for each pair of nodes; the root is of none.
            Buffer::TopParents => self.top_nodes / 2 + 1,
            Buffer::LevelStarts => self.levels,
            Buffer::SmallRoots | Buffer::SmallSizes | Buffer::SmallAddresses => self.small_roots,
            Buffer::MiddleRoots | Buffer::MiddleSizes if self.middle => self.small_roots,
            Buffer::MiddleReferences if self.middle => self.middle_references,
            Buffer::MiddleNodes if self.middle => self.middle_nodes,
            Buffer::MiddleLeaves if self.middle => self.middle_leaves,
            Buffer::MiddleRoots
            | Buffer::MiddleSizes
            | Buffer::MiddleReferences
            | Buffer::MiddleNodes
            | Buffer::MiddleLeaves => 1,
            Buffer::Nodes => self.tree_nodes,
            Buffer::LeafReferences => self.leaf_references,
            Buffer::Subtrees => self.subtrees,
        }
    }

    /// Bytes of a buffer.
    pub(crate) fn bytes_of(&self, buffer: Buffer) -> u64 {
        let bytes = match buffer {
            Buffer::Input => self.input_bytes,
            // Kernels read four words at a time.
            Buffer::Triangles => (36 * u64::from(self.triangles)).next_multiple_of(16),
            _ => u64::from(self.of(buffer)) * buffer.element_size() as u64,
        };
        if self.by_halves && is_long(buffer) { halves::bytes_in_halves(bytes) } else { bytes }
    }

    /// Elements of the first half of a list of references; all of them where one binding holds it.
    fn half_of(&self, buffer: Buffer) -> u32 {
        if !self.by_halves {
            return u32::MAX;
        }
        let elements = halves::first_half(self.bytes_of(buffer)) / buffer.element_size() as u64;
        u32::try_from(elements).unwrap_or(u32::MAX)
    }

    /// The buffers that grow, each storage once; [`Buffer::ChunkBins`] only where planes are found by
    /// bins.
    pub(crate) const BUFFERS: [Buffer; 27] = [
        Buffer::Triangles,
        Buffer::References,
        Buffer::NextReferences,
        Buffer::SmallReferences,
        Buffer::ActiveNodes,
        Buffer::NextNodes,
        Buffer::NodeBounds,
        Buffer::Chunks,
        Buffer::ChunkState,
        Buffer::ChunkBins,
        Buffer::Decisions,
        Buffer::TopNodes,
        Buffer::LevelStarts,
        Buffer::SmallRoots,
        Buffer::SmallSizes,
        Buffer::Subtrees,
        Buffer::MiddleRoots,
        Buffer::MiddleReferences,
        Buffer::MiddleNodes,
        Buffer::MiddleLeaves,
        Buffer::MiddleSizes,
        Buffer::SmallAddresses,
        Buffer::TopParents,
        Buffer::TopSizes,
        Buffer::TopAddresses,
        Buffer::Nodes,
        Buffer::LeafReferences,
    ];

    /// Capacities no larger than a device can bind. An estimate that is cut may still suffice; what
    /// grew because it did not (`needed`) may not be cut.
    ///
    /// # Errors
    /// A capacity that is needed but not available.
    pub(crate) fn within(
        mut self,
        limits: &wgpu::Limits,
        needed: Option<&Capacities>,
        config: &BuildConfig,
    ) -> Result<Capacities, GpuError> {
        let one_binding = binding_limit(limits);
        let needed_bytes = |buffer: Buffer| match buffer {
            Buffer::Input | Buffer::Triangles => self.bytes_of(buffer),
            _ => needed.map_or(0, |needed| needed.bytes_of(buffer)),
        };
        self.by_halves |= LONG.into_iter().any(|buffer| needed_bytes(buffer) > one_binding.0);
        let by_halves = self.by_halves;
        let limit_of = |buffer: Buffer| match by_halves && is_long(buffer) {
            true => halves_limit(limits),
            false => one_binding,
        };
        let most = |buffer: Buffer| {
            u32::try_from(limit_of(buffer).0 / buffer.element_size() as u64).unwrap_or(u32::MAX)
        };
        let beyond = |buffer: Buffer, needed: u64| GpuError::Limit {
            what: format!("the buffer of {buffer:?} for this scene"),
            limit: limit_of(buffer).1,
            needed: needed * buffer.element_size() as u64,
            allowed: limit_of(buffer).0,
        };
        let rooms: [(&mut u32, Buffer); 8] = [
            (&mut self.references, Buffer::References),
            (&mut self.small_roots, Buffer::SmallRoots),
            (&mut self.small_references, Buffer::SmallReferences),
            (&mut self.top_nodes, Buffer::TopNodes),
            (&mut self.tree_nodes, Buffer::Nodes),
            (&mut self.leaf_references, Buffer::LeafReferences),
            (&mut self.triangles, Buffer::Triangles),
            // Never needed.
            (&mut self.subtrees, Buffer::Subtrees),
        ];
        for (room, buffer) in rooms {
            let needed = match buffer {
                Buffer::Triangles => *room,
                Buffer::Subtrees => 0,
                _ => needed.map_or(0, |needed| needed.of(buffer)),
            };
            if needed > most(buffer) {
                return Err(beyond(buffer, needed.into()));
            }
            *room = (*room).min(most(buffer));
        }
        if self.input_bytes > limit_of(Buffer::Input).0 {
            return Err(beyond(Buffer::Input, self.input_bytes / 4));
        }
        self = self.with_bounds(config);
        if self.middle {
            // Of its pool scenes have needed less than the estimate: one that a binding holds is tried, unless it has grown
            // beyond that already.
            let least = share(self.triangles, LEAST_POOL, 1, 16_384);
            let most = most(Buffer::MiddleReferences);
            if least <= most && needed.is_none_or(|needed| needed.middle_references <= most) {
                self.middle_references = self.middle_references.min(most);
            }
        }
        // It can be left out.
        if self.middle && self.too_long_for_middle_stage(limits).is_some() {
            self.middle = false;
        }
        if self.binned {
            let most = most(Buffer::ChunkBins);
            if self.too_many_chunks > most {
                return Err(beyond(Buffer::ChunkBins, self.too_many_chunks.into()));
            }
            // Seldom reached where T is small: every node may have a chunk of its own.
            self.chunks = self.chunks.min(most);
        }
        Ok(self)
    }

    /// Most references of a node that the levels hand over.
    pub(crate) fn hand_over_limit(&self, config: &BuildConfig) -> u32 {
        if self.middle { hand_over_limit(config) } else { config.small_node_limit() }
    }

    /// The parameters that kernels read.
    pub(crate) fn parameters(&self, config: &BuildConfig, first_index: u32) -> Parameters {
        Parameters {
            zero: 0,
            swapped: 0,
            first: 0,
            count: u32::MAX,
            traversal_cost: config.traversal_cost,
            intersection_cost: config.intersection_cost,
            block_width: config.block_width,
            small_node_limit: config.small_node_limit(),
            hand_over_limit: self.hand_over_limit(config),
            empty_cutoff: config.empty_cutoff(),
            max_depth: config.max_depth,
            reference_cap: config.reference_cap(self.triangles),
            node_cap: config.node_cap(self.triangles),
            first_index,
            chunk_room: self.chunks,
            node_room: self.nodes,
            reference_room: self.references,
            small_root_room: self.small_roots,
            small_reference_room: self.small_references,
            top_node_room: self.top_nodes,
            level_room: self.levels,
            tree_node_room: self.tree_nodes,
            leaf_reference_room: self.leaf_references,
            subtree_room: self.subtrees,
            middle_reference_room: self.middle_references,
            middle_node_room: self.middle_nodes,
            middle_leaf_room: self.middle_leaves,
            bins: config.bins(),
            clip: u32::from(config.clip),
            view: 0,
            reference_half: self.half_of(Buffer::References),
            small_reference_half: self.half_of(Buffer::SmallReferences),
        }
    }
}

/// The lists that two bindings may hold: those that have the most bytes, or else too few bindings would be left.
const LONG: [Buffer; 5] = [
    Buffer::Input,
    Buffer::Triangles,
    Buffer::References,
    Buffer::NextReferences,
    Buffer::SmallReferences,
];

/// The list whose capacity grows where one overflowed.
fn bounded_by(bit: Overflow) -> Buffer {
    match bit {
        Overflow::SmallRoots => Buffer::SmallRoots,
        Overflow::SmallReferences => Buffer::SmallReferences,
        Overflow::TopNodes => Buffer::TopNodes,
        Overflow::Levels => Buffer::LevelStarts,
        Overflow::TreeNodes => Buffer::Nodes,
        Overflow::LeafReferences => Buffer::LeafReferences,
        Overflow::MiddleRegions => Buffer::MiddleReferences,
        // The number of references bounds those of large nodes and of their chunks.
        Overflow::References
        | Overflow::Nodes
        | Overflow::Chunks
        | Overflow::Unfinished
        | Overflow::MiddleStage => Buffer::References,
    }
}

/// Whether two bindings may hold a list.
pub(crate) fn is_long(buffer: Buffer) -> bool {
    LONG.contains(&buffer)
}

#[cfg(test)]
mod tests {
    use splitplane_core::config::Preset;

    use super::*;

    #[test]
    fn default_limits_hold_a_million_triangles() {
        let config = BuildConfig::default();
        let estimate = Capacities::estimate(1_016_615, &config);
        let limits = wgpu::Limits::default();
        assert_eq!(estimate.within(&limits, None, &config).unwrap(), estimate);
        for buffer in Capacities::BUFFERS {
            assert!(estimate.bytes_of(buffer) <= binding_limit(&limits).0, "{buffer:?}");
        }
    }

    /// `builtin:city:4000000`, whose needs in `fast` the CPU's executor counted, fits at the first attempt.
    #[test]
    fn default_limits_hold_a_city_of_four_million() {
        let (config, limits) = (BuildConfig::default(), wgpu::Limits::default());
        let estimate = Capacities::estimate(3_999_796, &config);
        let estimate = Capacities { input_bytes: 32_104_176 + 47_997_552, ..estimate };
        let within = estimate.within(&limits, None, &config).unwrap();
        assert!(within.by_halves);
        // But not the pool of the middle stage, and the build will say so.
        let with_stage = estimate.with_middle_stage();
        assert!(!with_stage.within(&limits, None, &config).unwrap().middle);
        let needed = 32 * (10 * 3_999_796 + 16_384);
        let (list, allowed) = (Buffer::MiddleReferences, 128 << 20);
        let why = with_stage.too_long_for_middle_stage(&limits);
        assert_eq!(why, Some(MiddleStage::TooLong { list, needed, allowed }));
        let larger = wgpu::Limits {
            max_storage_buffer_binding_size: 2 << 30,
            max_buffer_size: 2 << 30,
            ..wgpu::Limits::default()
        };
        assert!(with_stage.within(&larger, None, &config).unwrap().middle);
        assert_eq!(with_stage.too_long_for_middle_stage(&larger), None);
        for (buffer, needed) in [
            (Buffer::Triangles, 3_999_796),
            (Buffer::References, 4_933_771),
            (Buffer::SmallReferences, 7_260_077),
            (Buffer::ActiveNodes, 36_086),
            (Buffer::ChunkState, 37_687),
            (Buffer::SmallRoots, 175_402),
            (Buffer::TopNodes, 437_873),
            (Buffer::Nodes, 1_453_781),
            (Buffer::LeafReferences, 8_199_247),
        ] {
            assert!(within.of(buffer) >= needed, "{buffer:?}");
        }
        for buffer in Capacities::BUFFERS {
            let most = if is_long(buffer) { halves_limit } else { binding_limit };
            assert!(within.bytes_of(buffer) <= most(&limits).0, "{buffer:?}");
        }
    }

    /// Kernels read the nine words of a triangle as three elements of four words: the last one has them all.
    #[test]
    fn triangles_are_padded_to_four_words() {
        for triangles in 0..9u32 {
            let bytes =
                Capacities { triangles, ..Capacities::estimate(9, &BuildConfig::default()) }
                    .bytes_of(Buffer::Triangles);
            let last = u64::from((9 * triangles).saturating_sub(9) / 4 + 3);
            assert!(triangles == 0 || bytes >= 16 * last, "{triangles}");
            assert!(bytes.is_multiple_of(16) && bytes < u64::from(36 * triangles) + 16);
        }
    }

    /// The trees of sponza, 279,163 triangles: a first build finds room for them.
    #[test]
    fn small_leaves_have_room() {
        for (preset, nodes, references) in
            [(Preset::Fast, 137_699, 791_906), (Preset::Narrow, 1_224_000, 1_580_000)]
        {
            let estimate = Capacities::estimate(279_163, &preset.config());
            assert!(estimate.tree_nodes >= nodes && estimate.leaf_references >= references);
        }
    }

    #[test]
    fn what_overflowed_grows_and_nothing_else() {
        let config = BuildConfig::default();
        let estimate = Capacities::estimate(1000, &config);
        let mut counters = Counters::default();
        counters[Counter::Overflow] = Overflow::TopNodes as u32;
        counters[Counter::TopNodes] = 1;
        let grown = estimate.grown(&counters, &config, &wgpu::Limits::default());
        assert_eq!(grown, Capacities { top_nodes: 2 * estimate.top_nodes, ..estimate });
    }

    /// A list that doubles grows to what can be bound, and beyond only where it has that already.
    #[test]
    fn lists_grow_to_two_bindings() {
        let (config, limits) = (BuildConfig::default(), wgpu::Limits::default());
        let estimate = Capacities::estimate(3_000_000, &config);
        let cut = estimate.within(&limits, None, &config).unwrap();
        assert_eq!((cut.small_references, cut.by_halves), (1 << 22, false));
        let mut counters = Counters::default();
        counters[Counter::Overflow] = Overflow::SmallReferences as u32;
        counters[Counter::SmallReferences] = cut.small_references + 1;
        let grown = cut.grown(&counters, &config, &limits);
        let grown = grown.within(&limits, Some(&grown), &config).unwrap();
        assert_eq!((grown.small_references, grown.by_halves), ((1 << 23) - 512, true));
        assert!(grown.bytes_of(Buffer::SmallReferences) <= limits.max_buffer_size);
        counters[Counter::SmallReferences] = grown.small_references + 1;
        let again = grown.grown(&counters, &config, &limits);
        let error = again.within(&limits, Some(&again), &config).unwrap_err();
        let GpuError::Limit { what, needed, allowed, .. } = error else { panic!("{error}") };
        assert!(what.contains("SmallReferences"), "{what}");
        assert_eq!((needed, allowed), (32 * ((1 << 23) - 511), 32 * ((1 << 23) - 512)));
    }

    /// Bins of chunks are there only where planes are found by them. Where every node may have a
    /// chunk of its own they are cut to what can be bound; chunks that then lack space end in an
    /// error.
    #[test]
    fn bins_are_cut_until_they_are_needed() {
        let fast = BuildConfig::default();
        let estimate = Capacities::estimate(1_000_000, &fast);
        assert_eq!(estimate.bytes_of(Buffer::ChunkBins), 0);
        let config = Preset::Balanced.config().with_stages(|stages| stages.small_node_limit = 1);
        let limits = wgpu::Limits::default();
        let (most, _) = binding_limit(&limits);
        let estimate = Capacities::estimate(1_000_000, &config);
        assert!(estimate.bytes_of(Buffer::ChunkBins) > most);
        let cut = estimate.within(&limits, None, &config).unwrap();
        assert!(cut.bytes_of(Buffer::ChunkBins) <= most && cut.chunks >= most as u32 / 768);
        assert_eq!(Capacities { chunks: estimate.chunks, ..cut }, estimate);
        // All other capacities stay as they are.
        let mut counters = Counters::default();
        counters[Counter::Overflow] = Overflow::Chunks as u32;
        counters[Counter::Chunks] = cut.chunks + 1;
        let grown = cut.grown(&counters, &config, &limits);
        let error = grown.within(&limits, Some(&grown), &config).unwrap_err();
        let GpuError::Limit { what, needed, allowed, .. } = error else { panic!("{error}") };
        assert!(what.contains("ChunkBins"), "{what}");
        assert_eq!((needed, allowed), (768 * u64::from(cut.chunks + 1), most));
    }

    #[test]
    fn a_room_that_cannot_be_had_is_named() {
        let config = BuildConfig::default();
        let limits = wgpu::Limits::default();
        let mut needed = Capacities::estimate(1000, &config);
        needed.small_references = 10_000_000;
        let error = needed.within(&limits, Some(&needed), &config).unwrap_err();
        let GpuError::Limit { limit, needed, allowed, .. } = error else { panic!("{error}") };
        assert_eq!(
            (limit, needed, allowed),
            ("max_storage_buffer_binding_size", 320_000_000, 2 * ((128 << 20) - 8192))
        );
    }
}
