//! Kernel sets with their shaders: what one test holds all of them to.

use splitplane_core::kernel::{
    Access, Binding, Buffer, CheckBuffer, CompressBuffer, DeviceChecks, Grid, Kernel, KernelSet,
    NearBuffer, NearQueries, NodeCompressor, PointBuffer, PointBuilder, PointQueries,
    PointQueryBuffer, QueryBuffer, RayQueries, Slot, TreeBuilder,
};
use splitplane_render::RayTracer;
use splitplane_render::kernel as render_kernel;
use splitplane_shaders::{
    CHECKS, COMPRESS, KERNEL_RETRIES, KERNELS, NEAR, POINT_BUILD, POINTS, QUERIES, RENDER,
    RENDER_COMPRESSED, RENDER_RETRIES, RENDER_SETTLES, Shader, find, kernel_retry,
};

use super::bindings;
use super::constants::{self, Known, snake};
use super::records::{self, Record};
use super::render;
use crate::source::{Parsed, Text, texts};

/// A kernel set whose kernels have shaders.
pub(crate) trait Shaders: KernelSet {
    /// The shaders, by kernel and in the order of kernels, each with all that it may have.
    const TABLE: &'static [Shader];
    /// What finishes what kernels leave to it.
    const RETRIES: &'static [&'static [Shader]] = &[];
    /// The folder of the kernels' own files.
    const FOLDER: &'static str;
    /// The file of `lib/` with the twins of records.
    const LAYOUT: &'static str;
    /// Buffers that hold one record, not a list.
    const SINGLES: &'static [Self::Buffer];
    /// Whether lists of whole vectors may be bound four words at a time.
    const BY_FOUR_WORDS: bool = true;
    /// Lists of other elements that may be too: devices make them a multiple of 16 bytes long.
    const PADDED: &'static [Self::Buffer] = &[];

    /// Every text that a kernel may have.
    fn texts() -> Vec<(Self::Kernel, Vec<Text>)> {
        let text = |shader: &Shader| (kernel_of::<Self>(shader), texts(shader));
        Self::TABLE.iter().map(text).collect()
    }

    /// Whether a text has all that its kernel may have.
    fn is_whole(_kernel: Self::Kernel, _parts: &[Text]) -> bool {
        true
    }

    /// What a text of a kernel binds.
    fn bound(kernel: Self::Kernel, _parts: &[Text]) -> Vec<Slot<Self>> {
        Self::slots(kernel).collect()
    }

    /// The records that may cross, uniforms among them.
    fn records() -> Vec<Record>;

    /// The constants of Rust.
    fn known() -> Known {
        constants::of_core()
    }
}

/// The kernel that a shader is of: the one of its name, or of its file's.
pub(crate) fn kernel_of<S: Shaders>(shader: &Shader) -> S::Kernel {
    let own = shader.parts.last().map_or("", |part| part.name);
    let named = |name: &str| S::KERNELS.iter().find(|row| row.name == name);
    let row = named(shader.name).or_else(|| named(own));
    row.unwrap_or_else(|| panic!("{}: no such kernel", shader.name)).kernel
}

/// The text of a kernel with all that it may have.
pub(crate) fn text_of<S: Shaders>(kernel: S::Kernel) -> Vec<Text> {
    let shader = S::TABLE.iter().find(|shader| kernel_of::<S>(shader) == kernel);
    texts(shader.expect("a shader of the table"))
}

impl Shaders for TreeBuilder {
    const TABLE: &'static [Shader] = KERNELS;
    const RETRIES: &'static [&'static [Shader]] = &[KERNEL_RETRIES];
    const FOLDER: &'static str = "kernels";
    const LAYOUT: &'static str = "layout";
    const SINGLES: &'static [Buffer] = &[Buffer::Counters];
    const BY_FOUR_WORDS: bool = false;
    const PADDED: &'static [Buffer] = &[Buffer::Triangles];

    /// Those of what finishes a kernel's work too, over the same bindings.
    fn texts() -> Vec<(Kernel, Vec<Text>)> {
        let of_retry = |shader: &Shader| {
            let own = find(shader.name.strip_suffix("_retry").expect("a retry")).expect("a kernel");
            (kernel_of::<TreeBuilder>(own), texts(shader))
        };
        let own = KERNELS.iter().map(|shader| (kernel_of::<TreeBuilder>(shader), texts(shader)));
        own.chain(KERNEL_RETRIES.iter().map(of_retry)).collect()
    }

    /// What finishes a kernel's work may read what that has scattered.
    fn bound(kernel: Kernel, parts: &[Text]) -> Vec<Slot<TreeBuilder>> {
        let is_retry = parts.last().is_some_and(|own| own.name.ends_with("_retry"));
        let readable = |slot: Slot<TreeBuilder>| match slot {
            Slot::Storage(Binding { buffer, access: Access::Scatter }) if is_retry => {
                Slot::Storage(Binding { buffer, access: Access::ReadWrite })
            }
            slot => slot,
        };
        TreeBuilder::slots(kernel).map(readable).collect()
    }

    /// Where two texts share the work, another test holds them to their table together.
    fn is_whole(kernel: Kernel, _parts: &[Text]) -> bool {
        kernel_retry(kernel.name()).is_none()
    }

    fn records() -> Vec<Record> {
        records::of_core()
    }
}

impl Shaders for RayTracer {
    const TABLE: &'static [Shader] = RENDER;
    const RETRIES: &'static [&'static [Shader]] =
        &[RENDER_COMPRESSED, RENDER_RETRIES, RENDER_SETTLES];
    const FOLDER: &'static str = "render";
    const LAYOUT: &'static str = "render_layout";
    const SINGLES: &'static [render_kernel::Buffer] = &[render_kernel::Buffer::Counters];

    /// With every choice of features: what a scene does not need may be missing, and nothing else.
    fn texts() -> Vec<(render_kernel::Kernel, Vec<Text>)> {
        render::variants()
    }

    fn is_whole(kernel: render_kernel::Kernel, parts: &[Text]) -> bool {
        let whole = text_of::<RayTracer>(kernel);
        whole.iter().map(|part| &part.name).eq(parts.iter().map(|part| &part.name))
    }

    /// Through compressed nodes the same kernel binds these.
    fn bound(kernel: render_kernel::Kernel, parts: &[Text]) -> Vec<Slot<RayTracer>> {
        let compressed = parts.iter().any(|part| part.name == render::COMPRESSED_TREE);
        let slots = RayTracer::slots(kernel);
        slots
            .map(|slot| if compressed { render_kernel::of_compressed(slot) } else { slot })
            .collect()
    }

    fn records() -> Vec<Record> {
        let mut all = render::records();
        all.extend(records::of_queries());
        all
    }

    fn known() -> Known {
        render::known()
    }
}

impl Shaders for RayQueries {
    const TABLE: &'static [Shader] = QUERIES;
    const FOLDER: &'static str = "queries";
    const LAYOUT: &'static str = "ray";
    const SINGLES: &'static [QueryBuffer] = &[QueryBuffer::Limits];

    fn records() -> Vec<Record> {
        records::of_queries()
    }
}

impl Shaders for NodeCompressor {
    const TABLE: &'static [Shader] = COMPRESS;
    const FOLDER: &'static str = "compress";
    const LAYOUT: &'static str = "compress_layout";
    const SINGLES: &'static [CompressBuffer] = &[CompressBuffer::Counters];

    fn records() -> Vec<Record> {
        records::of_compressor()
    }
}

impl Shaders for PointBuilder {
    const TABLE: &'static [Shader] = POINT_BUILD;
    const FOLDER: &'static str = "point_build";
    const LAYOUT: &'static str = "point_layout";
    const SINGLES: &'static [PointBuffer] = &[PointBuffer::Counters];

    fn records() -> Vec<Record> {
        records::of_points()
    }
}

impl Shaders for PointQueries {
    const TABLE: &'static [Shader] = POINTS;
    const FOLDER: &'static str = "points";
    const LAYOUT: &'static str = "point_walk";
    const SINGLES: &'static [PointQueryBuffer] = &[];

    fn records() -> Vec<Record> {
        records::of_points()
    }
}

impl Shaders for NearQueries {
    const TABLE: &'static [Shader] = NEAR;
    const FOLDER: &'static str = "near";
    const LAYOUT: &'static str = "near_layout";
    const SINGLES: &'static [NearBuffer] = &[];

    fn records() -> Vec<Record> {
        records::of_near()
    }
}

impl Shaders for DeviceChecks {
    const TABLE: &'static [Shader] = CHECKS;
    const FOLDER: &'static str = "checks";
    const LAYOUT: &'static str = "";
    const SINGLES: &'static [CheckBuffer] = &[];

    fn records() -> Vec<Record> {
        records::of_queries()
    }
}

/// All faults of a kernel's text.
pub(crate) fn faults<S: Shaders>(parts: &[Text], kernel: S::Kernel, known: &Known) -> Vec<String> {
    let parsed = match Parsed::new(parts.to_vec()) {
        Ok(parsed) => parsed,
        Err(error) => return vec![error],
    };
    let mut faults = bindings::limit_faults(&parsed);
    let bound = S::bound(kernel, parts);
    faults.extend(bindings::binding_faults::<S>(&parsed, &bound));
    faults.extend(bindings::use_faults::<S>(&parsed, &bound, S::is_whole(kernel, parts)));
    faults.extend(bindings::grid_faults::<S>(&parsed, kernel));
    faults.extend(records::faults(&parsed, &S::records(), S::LAYOUT));
    faults.extend(constants::faults(&parsed, parts, known));
    faults
}

/// Faults of a table itself.
pub(crate) fn table_faults<K: KernelSet>() -> Vec<String> {
    let mut faults = Vec::new();
    let mut names: Vec<&str> = K::KERNELS.iter().map(|row| row.name).collect();
    names.extend(K::BUFFERS.iter().map(|row| row.name));
    for (place, name) in names.iter().enumerate() {
        // A kernel may have the name of what it makes.
        let kernels = K::KERNELS.len();
        let others = if place < kernels { &names[..place] } else { &names[kernels..place] };
        if others.contains(name) {
            faults.push(format!("{name} twice"));
        }
    }
    for row in K::KERNELS {
        let name = row.name;
        if snake(&format!("{:?}", row.kernel)) != name {
            faults.push(format!("{:?} is called {name}", row.kernel));
        }
        let named = |slots: &[Slot<K>], slot: &Slot<K>| {
            slots.iter().any(|other| match (other, slot) {
                (Slot::Storage(a), Slot::Storage(b)) => a.buffer == b.buffer,
                _ => other == slot,
            })
        };
        for (place, slot) in row.slots.iter().enumerate() {
            if named(&row.slots[..place], slot) {
                faults.push(format!("{name} names {slot:?} twice"));
            }
        }
        let slots: Vec<Slot<K>> = K::slots(row.kernel).collect();
        let storages = slots.iter().filter(|slot| matches!(slot, Slot::Storage(_))).count();
        if storages > bindings::MAX_STORAGE_BUFFERS {
            faults.push(format!("{name} binds {storages} storage buffers"));
        }
        // Where many workgroups write counters, their order may show.
        let mut counts = false;
        K::written(row.kernel, &mut |buffer| counts |= K::is_bound_by_all(buffer));
        if counts && row.grid != Grid::One {
            faults.push(format!("{name} writes counters from many workgroups"));
        }
    }
    for row in K::BUFFERS {
        let other = K::buffer(K::exchanged(row.buffer));
        if other.element_size != row.element_size {
            faults.push(format!("{} cannot stand for {}", other.name, row.name));
        }
    }
    faults
}
