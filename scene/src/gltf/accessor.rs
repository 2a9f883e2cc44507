//! Accessors to numbers.

use super::buffers::Buffers;
use super::{MISSING, at, wrong};
use crate::mesh_file::{Located, MeshFileProblem, room};
use gltf_json::accessor::{Accessor, ComponentType, Type};
use gltf_json::validation::Checked;
use gltf_json::{Index, buffer};

/// Where the elements of an accessor, or of its sparse part, are.
#[derive(Clone, Copy)]
struct Rows<'b> {
    bytes: &'b [u8],
    stride: usize,
}

impl Rows<'_> {
    /// The numbers of an element. It was checked that they are there.
    fn row<const N: usize>(&self, index: usize, kind: ComponentType, is_normal: bool) -> [f32; N] {
        let start = index * self.stride;
        std::array::from_fn(|part| {
            number(&self.bytes[start + part * size(kind)..], kind, is_normal)
        })
    }

    fn index(&self, index: usize, kind: ComponentType) -> u32 {
        let bytes = &self.bytes[index * self.stride..];
        match kind {
            ComponentType::U8 => u32::from(bytes[0]),
            ComponentType::U16 => u32::from(u16::from_le_bytes([bytes[0], bytes[1]])),
            _ => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
        }
    }
}

const fn size(kind: ComponentType) -> usize {
    match kind {
        ComponentType::I8 | ComponentType::U8 => 1,
        ComponentType::I16 | ComponentType::U16 => 2,
        ComponentType::U32 | ComponentType::F32 => 4,
    }
}

/// A number; whole ones as parts of the greatest where they are to be.
fn number(bytes: &[u8], kind: ComponentType, is_normal: bool) -> f32 {
    let two = || [bytes[0], bytes[1]];
    let four = || [bytes[0], bytes[1], bytes[2], bytes[3]];
    let (value, greatest) = match kind {
        ComponentType::F32 => return f32::from_le_bytes(four()),
        ComponentType::U32 => return u32::from_le_bytes(four()) as f32,
        ComponentType::I8 => (f32::from(bytes[0] as i8), 127.0),
        ComponentType::U8 => (f32::from(bytes[0]), 255.0),
        ComponentType::I16 => (f32::from(i16::from_le_bytes(two())), 32767.0),
        ComponentType::U16 => (f32::from(u16::from_le_bytes(two())), 65535.0),
    };
    if is_normal { (value / greatest).max(-1.0) } else { value }
}

fn valid<T: Copy>(checked: &Checked<T>, field: impl Fn() -> String) -> Result<T, Located> {
    match checked {
        Checked::Valid(value) => Ok(*value),
        Checked::Invalid => Err(wrong(field(), "the value is not one of the format")),
    }
}

impl Buffers<'_> {
    /// The numbers of an accessor of this type.
    pub(super) fn numbers<const N: usize>(
        &mut self,
        index: Index<Accessor>,
        wanted: Type,
    ) -> Result<Vec<[f32; N]>, Located> {
        let field = |name: &str| format!("accessors[{}]{name}", index.value());
        let accessor = self.root().accessors.get(index.value());
        let accessor = accessor.ok_or_else(|| wrong(field(""), MISSING))?;
        if valid(&accessor.type_, || field(".type"))? != wanted {
            return Err(wrong(
                field(".type"),
                format!("the numbers wanted are of type {wanted:?}"),
            ));
        }
        let kind = valid(&accessor.component_type, || field(".componentType"))?.0;
        let count = accessor.count.0;
        self.spend(count.saturating_mul(4 * N as u64), || field(".count"))?;
        if accessor.buffer_view.is_none() {
            self.spend_zeros(count, || field(".count"))?;
        }
        let (width, is_normal) = (N * size(kind), accessor.normalized);
        let mut out: Vec<[f32; N]> = Vec::new();
        match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.unwrap_or_default().0;
                let rows = self.rows(view, offset, count, width, || field(".count"))?;
                room(&mut out, count as usize).map_err(|problem| at(field(""), problem))?;
                out.extend((0..count as usize).map(|row| rows.row::<N>(row, kind, is_normal)));
            }
            None => {
                room(&mut out, count as usize).map_err(|problem| at(field(""), problem))?;
                out.resize(count as usize, [0.0; N]);
            }
        }
        let Some(sparse) = &accessor.sparse else { return Ok(out) };
        let own = |name: &str| field(&format!(".sparse.{name}"));
        let (places, values) = (&sparse.indices, &sparse.values);
        let place_kind = valid(&places.component_type, || own("indices.componentType"))?.0;
        let rows =
            |view, offset, width| self.rows(view, offset, sparse.count.0, width, || own("count"));
        let where_to = rows(places.buffer_view, places.byte_offset.0, size(place_kind))?;
        let what = rows(values.buffer_view, values.byte_offset.0, width)?;
        for row in 0..sparse.count.0 as usize {
            let place = where_to.index(row, place_kind);
            let Some(to) = out.get_mut(place as usize) else {
                let (what, index) = ("element", i64::from(place));
                return Err(at(own("indices"), MeshFileProblem::PastEnd { what, index, count }));
            };
            *to = what.row::<N>(row, kind, is_normal);
        }
        Ok(out)
    }

    /// The numbers of an accessor of indices.
    pub(super) fn indices(&mut self, index: Index<Accessor>) -> Result<Vec<u32>, Located> {
        let field = |name: &str| format!("accessors[{}]{name}", index.value());
        let accessor = self.root().accessors.get(index.value());
        let accessor = accessor.ok_or_else(|| wrong(field(""), MISSING))?;
        let kind = valid(&accessor.component_type, || field(".componentType"))?.0;
        if valid(&accessor.type_, || field(".type"))? != Type::Scalar {
            return Err(wrong(field(".type"), "indices are of type SCALAR"));
        }
        if !matches!(kind, ComponentType::U8 | ComponentType::U16 | ComponentType::U32) {
            return Err(wrong(field(".componentType"), "indices are whole and not negative"));
        }
        let (Some(view), None) = (accessor.buffer_view, &accessor.sparse) else {
            return Err(wrong(field(""), "indices have a view, and no sparse part"));
        };
        let count = accessor.count.0;
        self.spend(count.saturating_mul(4), || field(".count"))?;
        let offset = accessor.byte_offset.unwrap_or_default().0;
        let rows = self.rows(view, offset, count, size(kind), || field(".count"))?;
        let mut out = Vec::new();
        room(&mut out, count as usize).map_err(|problem| at(field(""), problem))?;
        out.extend((0..count as usize).map(|row| rows.index(row, kind)));
        Ok(out)
    }

    /// Elements of a view, all of which are there.
    fn rows(
        &self,
        view: Index<buffer::View>,
        offset: u64,
        count: u64,
        width: usize,
        field: impl Fn() -> String,
    ) -> Result<Rows<'_>, Located> {
        let bytes = self.view(view)?;
        let stride = self.root().buffer_views.get(view.value()).and_then(|view| view.byte_stride);
        let stride = stride.map_or(width, |stride| stride.0);
        let bytes = usize::try_from(offset).ok().and_then(|offset| bytes.get(offset..));
        let bytes = bytes.unwrap_or_default();
        let most = bytes
            .len()
            .saturating_add(stride)
            .saturating_sub(width)
            .checked_div(stride)
            .unwrap_or(0);
        if bytes.len() < width && count > 0 || count > most as u64 {
            let most = if bytes.len() < width { 0 } else { most as u64 };
            let what = "elements of an accessor".to_owned();
            return Err(at(field(), MeshFileProblem::Count { what, count, most }));
        }
        Ok(Rows { bytes, stride })
    }
}
