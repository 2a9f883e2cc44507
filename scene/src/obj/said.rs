//! Notes on what files name, no more of them than somebody reads.

/// Most notes of one kind of file.
const MOST: usize = 100;

/// Sentences, and how many more there would be.
#[derive(Debug, Default)]
pub(super) struct Said {
    sentences: Vec<String>,
    more: u64,
}

impl Said {
    /// Adds a sentence, or counts it.
    pub(super) fn say(&mut self, sentence: impl FnOnce() -> String) {
        if self.sentences.len() < MOST {
            self.sentences.push(sentence());
        } else {
            self.more += 1;
        }
    }

    /// All notes.
    pub(super) fn sentences(mut self) -> Vec<String> {
        if self.more > 0 {
            self.sentences.push(format!("{} more notes like these are left out", self.more));
        }
        self.sentences
    }
}
