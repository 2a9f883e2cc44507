//! What edits of a scene's description mean for its queries.

/// What became of the edits since the last update that succeeded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Edits {
    /// There are none: what is built is what is described.
    Taken,
    /// No update has been tried since the last of them. Queries are refused, so that nobody forgets the update.
    Waiting,
    /// The update after them failed. They stay in the description, and what was built before answers.
    Refused,
}

impl Edits {
    /// After an update, which has succeeded or not.
    pub(crate) fn after_update(self, has_succeeded: bool) -> Edits {
        match self {
            _ if has_succeeded => Edits::Taken,
            Edits::Taken => Edits::Taken,
            Edits::Waiting | Edits::Refused => Edits::Refused,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Edits::{Refused, Taken, Waiting};

    #[test]
    fn only_a_failure_after_edits_refuses_them() {
        for edits in [Taken, Waiting, Refused] {
            assert_eq!(edits.after_update(true), Taken);
        }
        let after = [Taken, Waiting, Refused].map(|edits| edits.after_update(false));
        assert_eq!(after, [Taken, Refused, Refused]);
    }
}
