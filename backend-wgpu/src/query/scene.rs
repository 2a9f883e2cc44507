//! The data of the whole scene that every traversal reads, as laid out on the device.

pub use splitplane_core::layout::SceneUniform;

#[cfg(test)]
mod tests {
    use super::*;
    use std::mem::offset_of;

    /// The Rust struct has the size and offsets that WGSL's rules give its twin.
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
