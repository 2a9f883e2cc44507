//! The settings of a build.

use crate::config::{BuildConfig, Preset};
use crate::watch::Watch;

/// Build settings: the configuration that shapes the tree, and limits, which never change a tree
/// but may fail the build.
#[derive(Clone, Copy, Debug, Default)]
pub struct BuildOptions<'a> {
    /// What shapes the tree.
    pub config: BuildConfig,
    /// Most bytes that the build's buffers, the tree and the query layout may hold at once, in
    /// addition to the caller's mesh; `None` for no limit.
    pub max_memory: Option<u64>,
    /// What queries read: speed or little memory. Hits do not depend on it, bit for bit, nor does the tree.
    pub layout: QueryLayout,
    /// Receives the progress of the build, and may cancel it; `None` for no watch. Trees do not
    /// depend on it.
    pub watch: Option<&'a dyn Watch>,
}

impl<'a> BuildOptions<'a> {
    /// Options for loading a tree within the same limits, for the same layout, with the same watch.
    #[must_use]
    pub const fn for_loading(&self) -> LoadOptions<'a> {
        let BuildOptions { max_memory, layout, watch, .. } = *self;
        LoadOptions { max_memory, layout, watch }
    }

    /// The same options with a limit reduced by so many bytes that are held besides.
    /// [`BuildError::beside`](crate::error::BuildError::beside) restates an error by the limit as it was.
    #[must_use]
    pub const fn beside(&self, held: u64) -> BuildOptions<'a> {
        let BuildOptions { config, max_memory, layout, watch } = *self;
        let max_memory = match max_memory {
            Some(limit) => Some(limit.saturating_sub(held)),
            None => None,
        };
        BuildOptions { config, max_memory, layout, watch }
    }

    /// The same without a watch, which can be kept for any time.
    #[must_use]
    pub const fn unwatched(&self) -> BuildOptions<'static> {
        let BuildOptions { config, max_memory, layout, .. } = *self;
        BuildOptions { config, max_memory, layout, watch: None }
    }
}

impl From<Preset> for BuildOptions<'_> {
    fn from(preset: Preset) -> Self {
        BuildOptions::from(preset.config())
    }
}

impl From<BuildConfig> for BuildOptions<'_> {
    fn from(config: BuildConfig) -> Self {
        BuildOptions { config, ..BuildOptions::default() }
    }
}

/// How to load a tree that was built earlier. Its configuration is part of the tree.
#[derive(Clone, Copy, Debug, Default)]
pub struct LoadOptions<'a> {
    /// Most bytes that the tree, the query layout and what they are made with may hold at once, in
    /// addition to the caller's mesh; `None` for no limit.
    pub max_memory: Option<u64>,
    /// What queries read; see [`BuildOptions::layout`].
    pub layout: QueryLayout,
    /// Receives the progress, and may cancel the work; `None` for no watch.
    pub watch: Option<&'a dyn Watch>,
}

/// How a backend lays out nodes and triangles for queries. The CPU has both layouts; backends with one
/// layout, such as wgpu, ignore the choice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum QueryLayout {
    /// Leaves have copies of their triangles' corners, side by side as the triangle test reads them.
    #[default]
    Fast,
    /// Leaves name their triangles, whose corners are read from one indexed copy of the mesh: a
    /// third to a half of the memory, and slower rays. A mesh without indices takes 36 bytes per
    /// triangle.
    Compact,
}

impl QueryLayout {
    /// Both, the default first.
    pub const ALL: [QueryLayout; 2] = [QueryLayout::Fast, QueryLayout::Compact];

    /// The name in options and reports.
    pub const fn name(self) -> &'static str {
        match self {
            QueryLayout::Fast => "fast",
            QueryLayout::Compact => "compact",
        }
    }
}
