//! The nodes and blocks of a point tree one by one, and the tree as text.

use crate::points::tree::{Axes, BLOCK, PointNode, PointTree};
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt::{self, Write};
use core::ops::Range;

/// A node or a block of a tree.
#[derive(Clone, Debug, PartialEq)]
pub struct Part<const N: usize> {
    /// Levels below the root.
    pub level: u32,
    /// The way from the root, one bit a level, that of the root's children the lowest: 1 for the right child.
    pub way: u32,
    /// Where the part is divided; `None` for a block.
    pub node: Option<PointNode>,
    /// The places of its points in [`PointTree::points`].
    pub places: Range<usize>,
    /// The least coordinates of its cell, in the tree's unit; not finite where no plane bounds it.
    pub lower: [f32; N],
    /// The greatest coordinates of its cell. Points of the left child may lie on the plane.
    pub upper: [f32; N],
}

/// A part that waits.
struct Waiting<const N: usize> {
    height: u32,
    block: usize,
    level: u32,
    way: u32,
    lower: [f32; N],
    upper: [f32; N],
}

/// Gives `visit` all nodes and blocks in preorder; where it returns false, those below a node are left out.
pub fn walk_parts<const N: usize>(tree: &PointTree<N>, mut visit: impl FnMut(&Part<N>) -> bool) {
    if tree.is_empty() {
        return;
    }
    let blocks = tree.nodes.len() + 1;
    let (lower, upper) = ([f32::NEG_INFINITY; N], [f32::INFINITY; N]);
    let mut stack =
        Vec::from([Waiting { height: tree.height(), block: 0, level: 0, way: 0, lower, upper }]);
    while let Some(Waiting { mut height, block, level, way, lower, upper }) = stack.pop() {
        let end = (blocks.min(block + (1 << height)) * BLOCK).min(tree.points.len());
        // Where a node's right half has no block, the left one stands for it.
        while height > 0 && block + (1 << (height - 1)) >= blocks {
            height -= 1;
        }
        let middle = block + (1 << height) / 2;
        let node = (height > 0).then(|| tree.nodes[middle - 1]);
        let part = Part { level, way, node, places: block * BLOCK..end, lower, upper };
        if !visit(&part) {
            continue;
        }
        if let Some(PointNode { plane, axis }) = node {
            let (mut left_upper, mut right_lower) = (upper, lower);
            left_upper[axis as usize] = plane;
            right_lower[axis as usize] = plane;
            let (height, level) = (height - 1, level + 1);
            let right_way = way | 1 << (level - 1);
            stack.push(Waiting {
                height,
                block: middle,
                level,
                way: right_way,
                lower: right_lower,
                upper,
            });
            stack.push(Waiting { height, block, level, way, lower, upper: left_upper });
        }
    }
}

/// The tree as text: its digest, counts and unit, then one line per node and block in preorder, indented by level: axis, plane in the
/// caller's unit and the plane's bits, or the indices of points. At most `most` lines of these; a last line says how many were left out.
pub fn dump<const N: usize>(tree: &PointTree<N>, most: usize) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = write_dump(&mut out, tree, most);
    out
}

fn write_dump<const N: usize>(out: &mut String, tree: &PointTree<N>, most: usize) -> fmt::Result {
    let axes = match tree.axes {
        Axes::Widest => "widest",
        Axes::Cycle => "cycle",
    };
    writeln!(out, "digest {}", tree.digest())?;
    writeln!(
        out,
        "dimensions {N} axes {axes} points {} dropped {} nodes {} unit 2^{}",
        tree.report.points,
        tree.report.dropped,
        tree.nodes.len(),
        tree.unit.exponent()
    )?;
    let (mut lines, mut result) = (0, Ok(()));
    walk_parts(tree, |part| {
        lines += 1;
        if lines <= most && result.is_ok() {
            result = write_part(out, tree, part);
        }
        true
    });
    result?;
    if lines > most {
        writeln!(out, "... {} more lines", lines - most)?;
    }
    Ok(())
}

fn write_part<const N: usize>(
    out: &mut String,
    tree: &PointTree<N>,
    part: &Part<N>,
) -> fmt::Result {
    let indent = 2 * part.level as usize;
    match part.node {
        Some(PointNode { plane, axis }) => {
            let axis = ['x', 'y', 'z', 'w'][axis as usize % 4];
            let own = tree.unit.of_units(plane);
            writeln!(out, "{:indent$}{axis} {own} {:08x}", "", plane.to_bits())
        }
        None => {
            write!(out, "{:indent$}block", "")?;
            for index in &tree.indices[part.places.clone()] {
                write!(out, " {index}")?;
            }
            writeln!(out)
        }
    }
}
