//! Measures splitplane: [`paper`] has the tables and figures of the survey that it implements, [`trade`] what
//! each setting costs on a scene and what it gets wrong. [`hierarchy`] is the structure that both compare with.

#![forbid(unsafe_code)]
#![cfg_attr(docsrs, feature(doc_cfg))]

pub mod hierarchy;
pub mod paper;
pub mod trade;
