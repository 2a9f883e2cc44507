//! What edits and updates came across.

/// What updates came across: sequences that reach nothing test nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reached {
    /// Updates that came to their end.
    pub updates: u64,
    /// Most instances of a scene.
    pub instances: usize,
    /// Instances that changed.
    pub changed: u64,
    /// Updates that gave several nodes of the tree over instances new boxes.
    pub refits: u64,
    /// Updates that built this tree anew although no instance had come or gone, since it was worn.
    pub worn: u64,
    /// Updates that were cancelled first.
    pub cancelled: u64,
    /// Updates that a limit of memory refused.
    pub refused: u64,
    /// Updates within a limit of memory.
    pub limited: u64,
    /// Updates by an updater that had spares.
    pub respared: u64,
    /// Spares that were dropped.
    pub cleared: u64,
    /// Geometries that got the arrays of another one.
    pub shared: u64,
    /// Groups of at least two instances that were baked.
    pub baked: u64,
    /// Bakings that were refused for what instances are, or for their size.
    pub unbaked: u64,
    /// Builds of a pending update that a watch or a limit ended.
    pub unbuilt: u64,
    /// Pending updates that were renewed with trees that they had.
    pub renewed: u64,
    /// Pending updates that came too late.
    pub outdated: u64,
    /// Pending updates that lacked a tree.
    pub lacking: u64,
    /// Pending updates with trees that were dropped.
    pub dropped: u64,
    /// Pending updates with trees that were put in place.
    pub finished: u64,
}

impl Reached {
    /// Both together.
    pub fn and(self, other: Reached) -> Reached {
        Reached {
            updates: self.updates + other.updates,
            instances: self.instances.max(other.instances),
            changed: self.changed + other.changed,
            refits: self.refits + other.refits,
            worn: self.worn + other.worn,
            cancelled: self.cancelled + other.cancelled,
            refused: self.refused + other.refused,
            limited: self.limited + other.limited,
            respared: self.respared + other.respared,
            cleared: self.cleared + other.cleared,
            shared: self.shared + other.shared,
            baked: self.baked + other.baked,
            unbaked: self.unbaked + other.unbaked,
            unbuilt: self.unbuilt + other.unbuilt,
            renewed: self.renewed + other.renewed,
            outdated: self.outdated + other.outdated,
            lacking: self.lacking + other.lacking,
            dropped: self.dropped + other.dropped,
            finished: self.finished + other.finished,
        }
    }
}
