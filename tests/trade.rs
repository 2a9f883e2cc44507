//! The verb `trade` from outside.
