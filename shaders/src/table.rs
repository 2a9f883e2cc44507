//! Which parts each shader is joined from.

use crate::{Part, Shader};

macro_rules! library {
    ($($constant:ident $name:literal)*) => {
        $(const $constant: Part =
            Part { name: $name, text: include_str!(concat!("../lib/", $name, ".wgsl")) };)*
        /// The modules that shaders share, by name.
        pub const LIBRARY: &[Part] = &[$($constant),*];
    };
}

macro_rules! shaders {
    ($(#[$doc:meta])* $table:ident $folder:literal { $($name:literal: $($part:ident)*;)* }) => {
        $(#[$doc])*
        pub const $table: &[Shader] = &[$(Shader {
            name: $name,
            parts: &[$($part,)* Part {
                name: $name,
                text: include_str!(concat!("../", $folder, "/", $name, ".wgsl")),
            }],
        }),*];
    };
}

library! {
    ARITHMETIC "arithmetic"
}

shaders! {
    /// The kernels of the tree builder, in the order of the schedule.
    KERNELS "kernels" {
    }
}

shaders! {
    /// The kernels of queries.
    QUERIES "queries" {
    }
}
