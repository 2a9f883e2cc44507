//! What every traversal reads of the scene as a whole, as it lies on the device.

use bytemuck::{Pod, Zeroable};
use splitplane_core::intersect::SceneScale;

/// The uniform `scene` of a traversal: [`SceneScale`] in the layout of the WGSL struct `Scene` of
/// `intersect.wgsl`. 64 bytes, no padding.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SceneUniform {
    /// Lower corner of the tree's bounds.
    pub lo: [f32; 3],
    /// Absolute slack of plane positions.
    pub slack: f32,
    /// Upper corner of the tree's bounds.
    pub hi: [f32; 3],
    /// 1 when exponents leave the range of the plain triangle test.
    pub wide: u32,
    /// Lower corner of the box in which an origin is not far.
    pub near_lo: [f32; 3],
    /// Always 0. Shaders take their opaque zero from here, which no compiler can see through.
    pub zero: u32,
    /// Upper corner of the box in which an origin is not far.
    pub near_hi: [f32; 3],
    /// What origin coordinates next to 0 are taken for.
    pub origin_least: f32,
}

impl From<&SceneScale> for SceneUniform {
    fn from(scale: &SceneScale) -> SceneUniform {
        SceneUniform {
            lo: scale.bounds.lo,
            slack: scale.slack,
            hi: scale.bounds.hi,
            wide: u32::from(scale.wide),
            near_lo: scale.near.lo,
            zero: 0,
            near_hi: scale.near.hi,
            origin_least: scale.origin_least,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::mem::offset_of;

    /// Size and offsets of the Rust struct are those that WGSL's rules give the twin.
    #[test]
    fn layout_is_that_of_the_wgsl_twin() {
        let source = splitplane_shaders::traversal(0, 0, Default::default());
        let module = naga::front::wgsl::parse_str(&source).expect("valid WGSL");
        let (members, span) = module
            .types
            .iter()
            .find_map(|(_, kind)| match &kind.inner {
                naga::TypeInner::Struct { members, span }
                    if kind.name.as_deref() == Some("Scene") =>
                {
                    Some((members.clone(), *span))
                }
                _ => None,
            })
            .expect("a struct Scene");
        let found: Vec<(String, usize)> = members
            .into_iter()
            .map(|member| (member.name.unwrap_or_default(), member.offset as usize))
            .collect();
        macro_rules! expected {
            ($($field:ident)*) => {
                vec![$((stringify!($field).to_string(), offset_of!(SceneUniform, $field))),*]
            };
        }
        assert_eq!(found, expected!(lo slack hi wide near_lo zero near_hi origin_least));
        assert_eq!(span as usize, size_of::<SceneUniform>());
    }
}
