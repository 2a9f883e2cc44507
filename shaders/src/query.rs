//! The shaders of queries by kernel and triangle test.

use crate::{QUERIES, Shader, TriangleTest};

/// The ending of a shader's name, after the kernel's.
const fn ending(test: TriangleTest) -> &'static str {
    match test {
        TriangleTest::Watertight => "",
        TriangleTest::MoellerTrumbore => "_fast",
        TriangleTest::Certain => "_exact",
    }
}

/// The shader of a query kernel with a triangle test; `None` for a kernel that there is not, or not
/// with this test. What traces no rays is there as if with the watertight one.
pub fn query(kernel: &str, test: TriangleTest) -> Option<&'static Shader> {
    QUERIES.iter().find(|shader| shader.name.strip_prefix(kernel) == Some(ending(test)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_query_has_the_test_that_is_asked_for() {
        for (test, has) in [
            (TriangleTest::Watertight, "watertight"),
            (TriangleTest::MoellerTrumbore, "moeller_trumbore"),
            (TriangleTest::Certain, "certain"),
        ] {
            let shader = query("any_hit", test).unwrap();
            assert!(shader.parts.iter().any(|part| part.name == has));
            assert_eq!(shader.parts.last().unwrap().name, "any_hit");
        }
        assert_eq!(query("triangle_limits", TriangleTest::Certain), None);
        assert_eq!(query("any", TriangleTest::Watertight), None);
    }
}
