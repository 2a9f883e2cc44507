//! The macro that makes a kernel set from its table.

/// Declares a kernel set: its type, its kernels, buffers and uniforms, and its
/// [`KernelSet`](crate::kernel::KernelSet). See [`TreeBuilder`](crate::kernel::TreeBuilder) for
/// one.
///
/// - `set NAME "name", counted by COUNTER;`: the set, and the enum of its counters, which is
///   declared apart. Then `every kernel:` what all of them bind first, and `exchanged:` the buffers
///   that change places between rounds.
/// - `uniforms`: a row is a variant and the variable's name in shaders, whose struct has the name of
///   the variant.
/// - `buffers`: a row is a variant, the variable's name in shaders, and bytes of an element; then
///   `live` the counter of its elements, if any, and `in` the buffer whose storage holds it on a
///   device, if not its own.
/// - `kernels`, in the order of the schedule: a row is a variant, the name of the file, the
///   [`Grid`](crate::kernel::Grid), and what the kernel does with which buffers, in the order of
///   bindings: it `reads` a buffer, `writes` all of it, `scatters` into it (writes some of it and reads
///   none) or `updates` it (reads and writes), or is given a `uniform`: see
///   [`Access`](crate::kernel::Access).
#[macro_export]
macro_rules! kernel_set {
    (
        $(#[$set_doc:meta])*
        set $Set:ident $set_name:literal, counted by $Counter:ident;
        every kernel: $($every_word:ident $every:ident),*;
        exchanged: $($first:ident with $second:ident),*;

        $(#[$uniforms_doc:meta])*
        uniforms $Uniform:ident {
            $($(#[$uniform_doc:meta])* $uniform:ident $uniform_name:literal;)*
        }

        $(#[$buffers_doc:meta])*
        buffers $Buffer:ident {
            $($(#[$buffer_doc:meta])* $buffer:ident $buffer_name:literal, $size:expr
                $(, live $live:ident)? $(, in $storage:ident)?;)*
        }

        $(#[$kernels_doc:meta])*
        kernels $Kernel:ident {
            $($(#[$kernel_doc:meta])* $kernel:ident $name:literal, $grid:expr =>
                $($word:ident $used:ident),*;)*
        }
    ) => {
        $(#[$set_doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $Set {}

        $(#[$uniforms_doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum $Uniform {
            $($(#[$uniform_doc])* $uniform,)*
        }

        $(#[$buffers_doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum $Buffer {
            $($(#[$buffer_doc])* $buffer,)*
        }

        $(#[$kernels_doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum $Kernel {
            $($(#[$kernel_doc])* $kernel,)*
        }

        impl $Buffer {
            const ROWS: &'static [$crate::kernel::BufferRow<$Set>] = &[$($crate::kernel::BufferRow {
                buffer: $Buffer::$buffer,
                name: $buffer_name,
                element_size: $size,
                live: $crate::kernel_set!(@live $Counter $($live)?),
                storage: $crate::kernel_set!(@storage $Buffer $buffer $($storage)?),
            }),*];

            /// Bytes of one element.
            pub const fn element_size(self) -> usize {
                Self::ROWS[self as usize].element_size
            }

            /// The counter that holds the number of live elements; `None` for a fixed length.
            pub const fn live(self) -> Option<$Counter> {
                Self::ROWS[self as usize].live
            }

            /// The buffer whose storage holds this one on a device.
            pub const fn storage(self) -> $Buffer {
                Self::ROWS[self as usize].storage
            }
        }

        impl $Kernel {
            const ROWS: &'static [$crate::kernel::KernelRow<$Set>] = &[$($crate::kernel::KernelRow {
                kernel: $Kernel::$kernel,
                name: $name,
                grid: {
                    #[allow(unused_imports, reason = "a set may use one kind of grid only")]
                    use $crate::kernel::Grid::{Each, Few, Invocations, One};
                    #[allow(unused_imports, reason = "one workgroup counts nothing")]
                    use $Counter::*;
                    $grid
                },
                slots: &[$($crate::kernel_set!(@slot $Buffer $Uniform $word $used)),*],
            }),*];

            /// All kernels, in the order of the schedule.
            pub const ALL: [$Kernel; Self::ROWS.len()] = [$($Kernel::$kernel),*];

            /// The name of the kernel's file.
            pub const fn name(self) -> &'static str {
                Self::ROWS[self as usize].name
            }

            /// What the kernel's workgroups represent.
            pub const fn grid(self) -> $crate::kernel::Grid<$Counter> {
                Self::ROWS[self as usize].grid
            }

            /// The buffers that the kernel reads and writes, in addition to those that every kernel
            /// binds.
            pub fn bindings(self) -> impl Iterator<Item = $crate::kernel::Binding<$Buffer>> {
                use $crate::kernel::{KernelSet, Slot};
                Self::ROWS[self as usize].slots.iter().filter_map(|slot| match slot {
                    Slot::Storage(binding) if !$Set::is_bound_by_all(binding.buffer) => Some(*binding),
                    _ => None,
                })
            }
        }

        impl $crate::kernel::KernelSet for $Set {
            type Kernel = $Kernel;
            type Buffer = $Buffer;
            type Uniform = $Uniform;
            type Counter = $Counter;

            const NAME: &'static str = $set_name;
            const KERNELS: &'static [$crate::kernel::KernelRow<$Set>] = $Kernel::ROWS;
            const BUFFERS: &'static [$crate::kernel::BufferRow<$Set>] = $Buffer::ROWS;
            const EVERY_KERNEL: &'static [$crate::kernel::Slot<$Set>] =
                &[$($crate::kernel_set!(@slot $Buffer $Uniform $every_word $every)),*];
            const EXCHANGED: &'static [($Buffer, $Buffer)] =
                &[$(($Buffer::$first, $Buffer::$second)),*];

            fn kernel_index(kernel: $Kernel) -> usize {
                kernel as usize
            }

            fn buffer_index(buffer: $Buffer) -> usize {
                buffer as usize
            }

            fn uniform_name(uniform: $Uniform) -> &'static str {
                match uniform {
                    $($Uniform::$uniform => $uniform_name,)*
                }
            }
        }
    };

    (@live $Counter:ident) => { None };
    (@live $Counter:ident $live:ident) => { Some($Counter::$live) };
    (@storage $Buffer:ident $own:ident) => { $Buffer::$own };
    (@storage $Buffer:ident $own:ident $storage:ident) => { $Buffer::$storage };
    (@slot $Buffer:ident $Uniform:ident uniform $name:ident) => {
        $crate::kernel::Slot::Uniform($Uniform::$name)
    };
    (@slot $Buffer:ident $Uniform:ident $word:ident $name:ident) => {
        $crate::kernel::Slot::Storage($crate::kernel::Binding {
            buffer: $Buffer::$name,
            access: $crate::kernel_set!(@access $word),
        })
    };
    (@access reads) => { $crate::kernel::Access::Read };
    (@access writes) => { $crate::kernel::Access::Write };
    (@access scatters) => { $crate::kernel::Access::Scatter };
    (@access updates) => { $crate::kernel::Access::ReadWrite };
}
