//! Drivers that do what WGSL lets them do and no driver at hand does, modelled by rewriting the arithmetic of a shader.

/// A driver: what it does, and the texts of `arithmetic.wgsl` that it replaces.
pub(crate) struct Driver {
    /// In words.
    pub(crate) name: &'static str,
    changes: &'static [[&'static str; 2]],
}

/// Free operations, as they stand in the text.
const FREE: [&str; 3] = ["    return a * b;\n", "    return a * b + c;\n", "    return a - b;\n"];
const GUARD: &str = "    return bitcast<f32>(bitcast<u32>(x) ^ opaque_zero);\n";
const RECIPROCAL: &str = "    return 1.0 / a;\n";

/// Drivers under which all results must stay as they are. WGSL allows reciprocals 2.5 units in the last place.
pub(crate) const ALLOWED: &[Driver] = &[
    Driver {
        name: "reciprocals are too large",
        changes: &[[RECIPROCAL, "    return bitcast<f32>(bitcast<u32>(1.0 / a) + 2u);\n"]],
    },
    Driver {
        name: "reciprocals are too small",
        changes: &[[RECIPROCAL, "    return bitcast<f32>(max(bitcast<u32>(1.0 / a), 2u) - 2u);\n"]],
    },
    Driver {
        name: "free operations round away from zero",
        changes: &[
            [
                FREE[0],
                "    let r = a * b; return select(r, bitcast<f32>(bitcast<u32>(r) + 1u), r != 0.0);\n",
            ],
            [
                FREE[1],
                "    let r = a * b + c; return select(r, bitcast<f32>(bitcast<u32>(r) + 1u), r != 0.0);\n",
            ],
            [
                FREE[2],
                "    let r = a - b; return select(r, bitcast<f32>(bitcast<u32>(r) + 1u), r != 0.0);\n",
            ],
        ],
    },
    Driver {
        name: "free operations round towards zero",
        changes: &[
            [
                FREE[0],
                "    let r = a * b; return select(r, bitcast<f32>(bitcast<u32>(r) - 1u), r != 0.0);\n",
            ],
            [
                FREE[1],
                "    let r = a * b + c; return select(r, bitcast<f32>(bitcast<u32>(r) - 1u), r != 0.0);\n",
            ],
            [
                FREE[2],
                "    let r = a - b; return select(r, bitcast<f32>(bitcast<u32>(r) - 1u), r != 0.0);\n",
            ],
        ],
    },
    Driver { name: "products and sums fuse", changes: &[[FREE[1], "    return fma(a, b, c);\n"]] },
    Driver {
        name: "subnormal results are flushed",
        changes: &[[
            GUARD,
            "    let r = bitcast<f32>(bitcast<u32>(x) ^ opaque_zero); return select(r, 0.0, abs(r) < LEAST_NORMAL);\n",
        ]],
    },
    Driver {
        name: "subnormal products are flushed before they are rounded",
        changes: &[[
            "    return guard(a * b);\n",
            // 2^126 times the product; factors are scaled up, so that nothing is lost.
            "    let up = scale(a, 63) * scale(b, 63); return select(guard(a * b), 0.0, abs(up) < 1.0);\n",
        ]],
    },
    Driver {
        name: "zeros lose their sign",
        changes: &[[
            GUARD,
            "    let r = bitcast<u32>(x) ^ opaque_zero; return bitcast<f32>(select(r, 0u, r == 0x80000000u));\n",
        ]],
    },
    Driver {
        name: "zeros become negative",
        changes: &[[
            GUARD,
            "    let r = bitcast<u32>(x) ^ opaque_zero; return bitcast<f32>(select(r, 0x80000000u, r == 0u));\n",
        ]],
    },
];

/// A driver that does what WGSL does not allow, and that a test of quotients must notice.
pub(crate) const FORBIDDEN: Driver = Driver {
    name: "reciprocals are wrong",
    changes: &[[RECIPROCAL, "    return bitcast<f32>(bitcast<u32>(1.0 / a) + 40u);\n"]],
};

/// A shader as a compiler has it that knows the word of the barrier, and so folds it away. That is a fault, which a test
/// must notice where such a compiler also fuses: see [`fused`].
pub(crate) fn folded(source: &str) -> String {
    assert!(source.contains(GUARD), "the barrier is not there");
    source.replace(GUARD, "    return x;\n")
}

/// A shader as a compiler has it that fuses each product with the sum that it goes into, where nothing stands in between.
/// The barrier does, so that a sound shader stays as it is.
pub(crate) fn fused(source: &str) -> String {
    if source.contains(GUARD) {
        return source.to_owned();
    }
    let mut out = String::new();
    let mut rest = source;
    while let Some(at) = rest.find("product(") {
        let (before, product) = rest.split_at(at);
        let inner = &product["product(".len()..];
        let end = closing(inner);
        let (factors, after) = (&inner[..end], &inner[end + 1..]);
        // difference(c, product(a, b)), as the shear of a corner has it.
        let open = before.rfind("difference(").map(|at| at + "difference(".len());
        let first = open.map(|open| &before[open..]).filter(|first| {
            let is_whole = closing(&format!("{first})")) == first.len();
            is_whole && first.trim_end().ends_with(',') && after.trim_start().starts_with(')')
        });
        match (first, split(factors)) {
            (Some(first), Some((a, b))) => {
                let call = before.len() - first.len() - "difference(".len();
                let addend = first.trim_end().trim_end_matches(',');
                out.push_str(&before[..call]);
                out.push_str(&format!("fma(-({a}), {b}, {addend}"));
            }
            _ => {
                out.push_str(before);
                out.push_str(&format!("product({factors})"));
            }
        }
        rest = after;
    }
    out + rest
}

/// Where the parenthesis that is open at the start of a text is closed; its length if nowhere.
fn closing(text: &str) -> usize {
    let mut depth = 1;
    let end = text.char_indices().find(|(_, letter)| {
        depth += match letter {
            '(' => 1,
            ')' => -1,
            _ => 0,
        };
        depth == 0
    });
    end.map_or(text.len(), |(at, _)| at)
}

/// The two arguments of a call.
fn split(arguments: &str) -> Option<(&str, &str)> {
    let mut depth = 0;
    let comma = arguments.char_indices().find(|(_, letter)| {
        depth += match letter {
            '(' => 1,
            ')' => -1,
            _ => 0,
        };
        *letter == ',' && depth == 0
    });
    comma.map(|(at, _)| (&arguments[..at], arguments[at + 1..].trim_start()))
}

/// A shader whose workgroups change places, the last with the first; `None` for one whose workgroups do not know which they are.
pub(crate) fn reordered(source: &str) -> Option<String> {
    let given = "@builtin(workgroup_id) group: vec3<u32>";
    let main = source.find("fn main(")?;
    source[main..].find(given)?;
    let body = main + source[main..].find("{\n").expect("a body") + 2;
    let (head, rest) = source.split_at(body);
    let mut head = head.replace(given, "@builtin(workgroup_id) group_as_given: vec3<u32>");
    let mut count = "groups";
    if !head[main..].contains("@builtin(num_workgroups) groups") {
        count = "all_groups";
        head = head.replace(
            "@builtin(workgroup_id)",
            "@builtin(num_workgroups) all_groups: vec3<u32>,\n    @builtin(workgroup_id)",
        );
    }
    let turned = format!(
        "    let group = vec3<u32>({count}.x - 1u - group_as_given.x, group_as_given.y, group_as_given.z);\n"
    );
    Some(head + &turned + rest)
}

impl Driver {
    /// A shader as this driver compiles it.
    ///
    /// # Panics
    /// If a text to replace is not there.
    pub(crate) fn compiled(&self, source: &str) -> String {
        let mut source = source.to_owned();
        for [right, changed] in self.changes {
            assert!(source.contains(right), "{}: the text is not there: {right}", self.name);
            source = source.replace(right, changed);
        }
        source
    }
}
