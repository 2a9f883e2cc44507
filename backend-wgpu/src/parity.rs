//! How near a device comes to the CPU.

use std::fmt;

/// What the self-test of a device found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Parity {
    /// Trees and watertight hits are those of the CPU, bit for bit.
    Bitwise,
    /// Trees are sound and rays are answered, but some bits differ; in words, which.
    Structural(String),
}

impl Parity {
    /// True for [`Parity::Bitwise`].
    pub fn is_bitwise(&self) -> bool {
        matches!(self, Parity::Bitwise)
    }

    /// `bitwise` or `structural`.
    pub fn name(&self) -> &'static str {
        match self {
            Parity::Bitwise => "bitwise",
            Parity::Structural(_) => "structural",
        }
    }
}

impl fmt::Display for Parity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Parity::Bitwise => f.write_str("bitwise"),
            Parity::Structural(difference) => write!(f, "structural: {difference}"),
        }
    }
}
