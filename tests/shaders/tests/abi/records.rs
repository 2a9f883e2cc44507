//! Structs that cross between the host and a device, word by word.
//!
//! A struct of WGSL agrees with the record of the same name in the core when it has the same size
//! and the same words: offset, kind and the member they belong to. How the words are grouped is
//! free: `[f32; 3]` may be `vec3<f32>`, `array<f32, 3>` or three members `lo_x`, `lo_y`, `lo_z` of
//! the same prefix, and a pair of words a `vec2<u32>`. Padding may be left out where the size is the
//! same without it.

use core::mem::offset_of;

use naga::Handle;
use naga::ir::{AddressSpace, ArraySize, ScalarKind, Type, TypeInner};
use splitplane_core::aabb::Aabb;
use splitplane_core::layout::{
    BatchUniform, CheckParameters, Chunk, ChunkBins, ChunkBounds, ChunkSides, Compress, Counters,
    Decision, Extent, LargeNode, MiddleRoot, NearBatch, Parameters, Part, PointBatch, PointBuild,
    PointExtent, PointRecord, PointSplit, Reference, SceneBatch, SceneUniform, Sides, SmallRoot,
    TopNode, TriangleCount, VertexCount,
};
use splitplane_core::ray::{Hit, Ray};
use splitplane_core::tree::node::KdNode;

use crate::source::Parsed;

/// The words of a type of Rust.
pub(crate) trait Words {
    /// The kind of each.
    fn kinds() -> Vec<ScalarKind>;
}

impl Words for u32 {
    fn kinds() -> Vec<ScalarKind> {
        vec![ScalarKind::Uint]
    }
}

impl Words for f32 {
    fn kinds() -> Vec<ScalarKind> {
        vec![ScalarKind::Float]
    }
}

impl<T: Words, const N: usize> Words for [T; N] {
    fn kinds() -> Vec<ScalarKind> {
        T::kinds().repeat(N)
    }
}

impl Words for Sides {
    fn kinds() -> Vec<ScalarKind> {
        <[u32; 2]>::kinds()
    }
}

impl Words for Aabb {
    fn kinds() -> Vec<ScalarKind> {
        <[f32; 6]>::kinds()
    }
}

/// A member of a record.
pub(crate) struct Member {
    pub name: &'static str,
    pub offset: usize,
    pub kinds: Vec<ScalarKind>,
}

/// A record of the core.
pub(crate) struct Record {
    pub name: &'static str,
    pub size: usize,
    pub members: Vec<Member>,
}

/// The kinds of a member's words, from how it is reached.
pub(crate) fn kinds_of<R, T: Words>(_: fn(&R) -> &T) -> Vec<ScalarKind> {
    T::kinds()
}

macro_rules! record {
    ($name:ident { $($member:ident)* }) => { record!($name as $name { $($member)* }) };
    ($wgsl:ident as $name:ident { $($member:ident)* }) => {{
        // Does not compile when a member is missing.
        let _ = |$name { $($member: _),* }: $name| {};
        Record {
            name: stringify!($wgsl),
            size: size_of::<$name>(),
            members: vec![$(Member {
                name: stringify!($member),
                offset: offset_of!($name, $member),
                kinds: kinds_of(|record: &$name| &record.$member),
            }),*],
        }
    }};
}

fn word(name: &'static str, offset: usize) -> Member {
    Member { name, offset, kinds: u32::kinds() }
}

/// The records of the node compressor.
pub(crate) fn of_compressor() -> Vec<Record> {
    vec![
        record!(Part { lo first hi count }),
        record!(Compress { slack zero batch_room part_room }),
        record!(Aabb { lo hi }),
    ]
}

/// The records of kernels that work on points.
pub(crate) fn of_points() -> Vec<Record> {
    vec![
        record!(PointBatch { count room points height reach filtered zero padding lower upper }),
        record!(PointBuild { given dimensions widest zero }),
        record!(PointRecord { x y z w point }),
        record!(PointSplit { axis bits rank known }),
        record!(PointExtent { lower upper }),
    ]
}

/// The records of queries for what is near.
pub(crate) fn of_near() -> Vec<Record> {
    vec![record!(NearBatch { count ignore room any lower zero upper padding })]
}

/// The records of queries and of the self-test.
pub(crate) fn of_queries() -> Vec<Record> {
    vec![
        record!(Ray { origin t_min direction t_max }),
        record!(Hit { t triangle u v }),
        record!(Scene as SceneUniform { lo slack hi wide near_lo zero near_hi origin_least }),
        record!(Batch as BatchUniform { count culling ignore room }),
        record!(SceneBatch {
            count culling mask ignored_instance ignored_triangle any zero way
        }),
        record!(TriangleCount { count zero }),
        record!(VertexCount { count zero }),
        record!(CheckParameters { zero count }),
        // An enum and an `Option` on the CPU.
        Record {
            name: "QueryOptions",
            size: 8,
            members: vec![word("culling", 0), word("ignore", 4)],
        },
    ]
}

/// The records of the tree builder.
pub(crate) fn of_core() -> Vec<Record> {
    vec![
        record!(Reference { lo triangle hi padding }),
        record!(LargeNode {
            lo first hi count node depth source source_chunks side inseparable first_chunk padding
        }),
        record!(Chunk { node first count span_sides }),
        record!(Sides { left right }),
        record!(ChunkSides { left right }),
        record!(ChunkBins { words }),
        record!(Decision {
            cuts cut_count cut_sides axis position counts first first_node source_first
        }),
        record!(TopNode { kind split left right }),
        record!(SmallRoot { lo first hi count node depth level padding }),
        record!(MiddleRoot {
            node first count levels nodes leaves references growth first_leaf first_reference outgrown
            padding
        }),
        record!(Extent { nodes references }),
        record!(ChunkBounds { sides }),
        record!(Counters { words }),
        record!(Parameters {
            zero swapped first count traversal_cost intersection_cost block_width small_node_limit
            hand_over_limit empty_cutoff max_depth reference_cap node_cap first_index chunk_room node_room
            reference_room small_root_room small_reference_room top_node_room level_room
            tree_node_room leaf_reference_room subtree_room middle_reference_room middle_node_room
            middle_leaf_room bins clip view
            reference_half small_reference_half
        }),
        record!(Aabb { lo hi }),
        // Its members are private.
        Record {
            name: "KdNode",
            size: size_of::<KdNode>(),
            members: vec![word("word", 0), word("tagged", 4)],
        },
    ]
}

/// Faults of the structs that a uniform or storage buffer holds, and of those in the file `layout`:
/// each must be one of these records. Others never cross, and may share a name with a record.
pub(crate) fn faults(parsed: &Parsed, records: &[Record], layout: &str) -> Vec<String> {
    let module = &parsed.module;
    let mut crossing = Vec::new();
    for (_, global) in module.global_variables.iter() {
        if matches!(global.space, AddressSpace::Uniform | AddressSpace::Storage { .. }) {
            reach(parsed, global.ty, &mut crossing);
        }
    }
    let mut faults = Vec::new();
    for (handle, ty) in module.types.iter() {
        let TypeInner::Struct { .. } = ty.inner else { continue };
        let place = parsed.place(module.types.get_span(handle));
        let crosses = crossing.contains(&handle);
        if !crosses && place.part != layout {
            continue;
        }
        let name = ty.name.as_deref().unwrap_or("?");
        match records.iter().find(|record| record.name == name) {
            Some(record) => {
                let found = compare(parsed, handle, record);
                faults.extend(found.into_iter().map(|what| format!("{name}: {what}, {place}")));
            }
            None => faults.push(format!("{name}: no record of the core, {place}")),
        }
    }
    faults
}

/// Collects the structs in a type.
fn reach(parsed: &Parsed, ty: Handle<Type>, into: &mut Vec<Handle<Type>>) {
    match &parsed.module.types[ty].inner {
        TypeInner::Array { base, .. } => reach(parsed, *base, into),
        TypeInner::Struct { members, .. } => {
            into.push(ty);
            members.iter().for_each(|member| reach(parsed, member.ty, into));
        }
        _ => {}
    }
}

/// A word of a struct of WGSL: its offset and kind.
type Word = (usize, ScalarKind);

/// The words of a type that begins at an offset; `None` for a type that has no such words.
fn words(parsed: &Parsed, ty: Handle<Type>, start: usize, into: &mut Vec<Word>) -> Option<()> {
    match &parsed.module.types[ty].inner {
        TypeInner::Scalar(scalar) | TypeInner::Atomic(scalar) if scalar.width == 4 => {
            into.push((start, scalar.kind));
        }
        TypeInner::Vector { size, scalar } if scalar.width == 4 => {
            into.extend((0..*size as usize).map(|i| (start + 4 * i, scalar.kind)));
        }
        TypeInner::Array { base, size: ArraySize::Constant(count), stride } => {
            for i in 0..count.get() {
                words(parsed, *base, start + (i * stride) as usize, into)?;
            }
        }
        TypeInner::Struct { members, .. } => {
            for member in members {
                words(parsed, member.ty, start + member.offset as usize, into)?;
            }
        }
        _ => return None,
    }
    Some(())
}

/// How a struct differs from a record.
fn compare(parsed: &Parsed, handle: Handle<Type>, record: &Record) -> Vec<String> {
    let TypeInner::Struct { members, span } = &parsed.module.types[handle].inner else {
        return vec!["not a struct".to_owned()];
    };
    let mut faults = Vec::new();
    if *span as usize != record.size {
        faults.push(format!("{span} bytes instead of {}", record.size));
    }
    let mut used = 0;
    for expected in &record.members {
        let end = expected.offset + 4 * expected.kinds.len();
        let range = expected.offset..end;
        let inside: Vec<_> =
            members.iter().filter(|member| range.contains(&(member.offset as usize))).collect();
        used += inside.len();
        if inside.is_empty() && expected.name.starts_with("padding") {
            continue;
        }
        let name = |index: usize| inside[index].name.as_deref().unwrap_or("");
        let prefix = format!("{}_", expected.name);
        let named = match inside.len() {
            1 => name(0) == expected.name,
            count => (0..count).all(|index| name(index).starts_with(&prefix)),
        };
        let mut found = Vec::new();
        let known = inside
            .iter()
            .all(|member| words(parsed, member.ty, member.offset as usize, &mut found).is_some());
        let wanted: Vec<Word> =
            (expected.offset..end).step_by(4).zip(expected.kinds.iter().copied()).collect();
        if !named || !known || found != wanted {
            faults.push(format!("member `{}` differs", expected.name));
        }
    }
    if used != members.len() {
        faults.push("a member that the record lacks".to_owned());
    }
    faults
}
