//! Formats of nodes are decoded in one place each: no other file shifts or masks their words.
//!
//! The lint reads the code of the core and of the CPU backend, statement by statement. A statement is found where it shifts or
//! masks by what formats of nodes use and names what holds a node's words, or where it names private parts of a codec.

use splitplane_test_support::sources::{code, rust_files, without_tests, workspace};

/// The codecs, and which format each has.
const CODECS: &[(&str, &str)] = &[
    ("core/src/tree/node.rs", "the canonical node of 8 bytes"),
    ("core/src/query/compressed/encode.rs", "compressed wide nodes and their children"),
    ("backend-cpu/src/layout/wide_node.rs", "wide nodes and their children"),
    ("backend-cpu/src/layout/packed_block.rs", "blocks of triangles"),
];

/// What is found by the rules and is no node: the file and a part of the statement.
const INNOCENT: &[(&str, &str)] = &[
    // Counts of a chunk's bins: starts below, ends above.
    ("core/src/build/bins.rs", "sum.ends[axis][bin] += word >> 16"),
    (
        "backend-cpu/src/build/twin/kernels/bin_references.rs",
        "*word = starts[bin] | ends[bin] << 16",
    ),
    ("core/src/build/reference/kernels/bin_references.rs", "words[axis][end as usize] += 1 << 16"),
    // Counts of a span of chunks: left below, right above.
    (
        "core/src/build/reference/kernels/count_children.rs",
        "span_sides += counts.left + (counts.right << 16)",
    ),
    // A stack's entries: a node of the tree over instances, and a bit for each child that is yet to be visited.
    ("core/src/backend/scene/packed/trace.rs", "nodes[(entry >> 8) as usize]"),
    ("core/src/backend/scene/packed/trace.rs", "child << 8 | 0xff"),
    // A mask of lanes.
    ("backend-cpu/src/simd/avx2.rs", "LANES_OF[kept as usize & 0xff]"),
];

/// Names of what holds a node's words, and of what is put into them.
const NAMES: &[&str] = &[
    "child",
    "children",
    "first",
    "first_word",
    "header",
    "kept",
    "leaf",
    "node",
    "nodes",
    "own",
    "parent",
    "right",
    "tag",
    "tagged",
    "unit",
    "word",
    "words",
];

/// What formats of nodes are shifted by and masked with: axis and child of a canonical node, the mark of a leaf among
/// children, the lengths of a block.
const SHIFTS: &[&str] = &["2", "7", "8", "16", "31", "SHIFT"];
const MASKS: &[&str] = &["3", "0b11", "0x3", "0x7f", "0xff", "MARK", "LARGE", "TAG"];

/// Names that only a codec has.
const PRIVATE: &[&str] = &["tagged", "LEAF_MARK"];

/// The tokens of some code: words and numbers, shifts, other characters.
fn tokens(code: &str) -> Vec<&str> {
    let mut tokens = Vec::new();
    let mut rest = code.trim_start();
    while !rest.is_empty() {
        let word = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
        let length = match word {
            0 if ["<<", ">>", "&&", "||"].iter().any(|two| rest.starts_with(two)) => 2,
            0 => rest.chars().next().map_or(1, char::len_utf8),
            word => word,
        };
        tokens.push(&rest[..length]);
        rest = rest[length..].trim_start();
    }
    tokens
}

/// Whether a statement takes a node's words apart, or puts them together.
fn touches_words(statement: &str) -> bool {
    let tokens = tokens(statement);
    if tokens.iter().any(|token| PRIVATE.contains(token)) {
        return true;
    }
    let ends_in = |token: &str, list: &[&str]| {
        let number = token.trim_end_matches("u32").trim_end_matches('_');
        list.iter().any(|&end| number == end || token.ends_with(&format!("_{end}")))
    };
    let operation = tokens.iter().enumerate().any(|(i, &operator)| {
        let mut behind =
            tokens[i + 1..].iter().skip_while(|token| ["!", "=", "("].contains(*token));
        // The last part of a path.
        let mut operand = behind.next().copied().unwrap_or_default();
        while behind.next() == Some(&":") && behind.next() == Some(&":") {
            operand = behind.next().copied().unwrap_or_default();
        }
        match operator {
            "<<" | ">>" => ends_in(operand, SHIFTS),
            "&" | "|" | "^" => ends_in(operand, MASKS),
            _ => false,
        }
    });
    operation && tokens.iter().any(|token| NAMES.contains(token))
}

/// Statements of some code, each with its line.
fn statements(code: &str) -> Vec<(usize, String)> {
    let (mut out, mut line) = (Vec::new(), 1);
    for statement in code.split_inclusive([';', '{', '}']) {
        let blank = statement.len() - statement.trim_start().len();
        out.push((line + statement[..blank].matches('\n').count(), statement.trim().to_owned()));
        line += statement.matches('\n').count();
    }
    out
}

/// Statements of a source that touch the words of nodes, each with its line.
fn found(source: &str) -> Vec<(usize, String)> {
    let mut found = statements(&without_tests(&code(source)));
    found.retain(|(_, statement)| touches_words(statement));
    found
}

#[test]
fn words_of_nodes_are_touched_by_their_codecs_alone() {
    let (mut outside, mut unused) = (String::new(), INNOCENT.to_vec());
    for folder in ["core/src", "backend-cpu/src"] {
        for file in rust_files(&workspace().join(folder)) {
            let text = std::fs::read_to_string(&file).expect("a source");
            let path = file.strip_prefix(workspace()).expect("a path below the workspace");
            let path = path.to_string_lossy().replace('\\', "/");
            if CODECS.iter().any(|(codec, _)| *codec == path) || path.ends_with("tests.rs") {
                continue;
            }
            for (line, statement) in found(&text) {
                let innocent =
                    |known: &(&str, &str)| known.0 == path && statement.contains(known.1);
                if INNOCENT.iter().any(&innocent) {
                    unused.retain(|known| !innocent(known));
                } else {
                    outside += &format!("{path}:{line}: {statement}\n");
                }
            }
        }
    }
    assert!(outside.is_empty(), "words of nodes are touched outside of their codecs:\n{outside}");
    assert!(unused.is_empty(), "not found any more, so they leave the list: {unused:?}");
}

/// The rules find what codecs do: each codec has statements that no other file may have.
#[test]
fn codecs_would_be_found() {
    for (codec, format) in CODECS {
        let text = std::fs::read_to_string(workspace().join(codec)).expect("a codec");
        assert!(found(&text).len() > 1, "{codec}: {format}");
    }
}

#[test]
fn planted_statements_are_found() {
    for planted in [
        "*parent = KdNode::from_words([split, tagged | right << 2]);",
        "let axis = node.words()[1] & 3;",
        "let [word, rest] = node.words();\nlet (left, right) = (node + 1, rest >> 2);",
        "let is_leaf = words[1] & 0b11 == 3;",
        "WalkNode { word: unit, tagged: blocks << WalkNode::SHIFT | 3 }",
        "while child & LEAF_MARK == 0 { child = 0; }",
        "let queue = (child >> 31) as usize;",
        "if child & !wide::CHILD_MARK == 0 { return; }",
        "out[0] = mark | header << 16;",
        "let count = words[0] & 0x7f;",
    ] {
        let source = format!("fn f() {{\n    {planted}\n}}\n");
        let found = found(&source);
        assert!(!found.is_empty(), "{planted}");
        assert!(found.iter().all(|(line, _)| (2..=3).contains(line)), "{found:?}");
    }
    for innocent in [
        "let axis = node.kind();",
        "// let axis = node.words()[1] & 3;",
        "let text = \"node & 3\";",
        "let octant = [i & 1, i >> 1 & 1, i >> 2 & 1];",
        "let node = &nodes[3];",
        "let more = node + 3 * right / 2;",
    ] {
        assert_eq!(found(&format!("fn f() {{ {innocent} }}")), [], "{innocent}");
    }
    let test = "#[cfg(test)]\nmod tests {\n    fn f() { node & 3 }\n}\n";
    assert_eq!(found(test), []);
}
