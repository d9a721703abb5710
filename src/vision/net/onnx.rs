//! The net as an ONNX file, for estimators in Python or C++.
//!
//! Input `patches`: float (n, 1, 64, 64), cut and scaled as [`crate::vision::dots::patch`] says. Outputs:
//! `cells`, float (n, 6, 32, 32), whose channels are those of [`Channel`](super::graph::Channel),
//! and `probability`, float (n, 1, 32, 32), the calibrated probability of a dot. The calibration
//! also stands in the model's metadata. Messages are those of the ONNX specification (onnx.proto,
//! IR version 8, operator set 13); only the fields in use are written.

use prost::Message;

use super::graph::{CELLS, Convolution, Step};
use super::weights::Weights;
use crate::vision::dots::patch::SIZE;

/// ONNX's version of its own format.
const IR_VERSION: i64 = 8;
/// Version of the operators.
const OPERATORS: i64 = 13;
/// Element type of 32-bit floats.
const FLOAT: i32 = 1;
/// Element type of 64-bit integers.
const INT64: i32 = 7;

/// The bytes of the ONNX file.
pub fn to_onnx(weights: &Weights) -> Vec<u8> {
    let mut nodes = Vec::new();
    let mut initializers = Vec::new();
    let graph = weights.meta.head.graph();
    for (i, (c, layer)) in std::iter::zip(graph.convolutions, &weights.layers).enumerate() {
        let shape = [c.outputs, c.inputs, c.kernel, c.kernel].map(|n| n as i64);
        initializers.push(Tensor::floats(
            &format!("weight{i:02}"),
            &shape,
            &layer.weight,
        ));
        initializers.push(Tensor::floats(
            &format!("bias{i:02}"),
            &shape[..1],
            &layer.bias,
        ));
    }
    initializers.push(Tensor::floats("double", &[4], &[1.0, 1.0, 2.0, 2.0]));
    let last = graph.steps.len();
    // The patch, the cells, or something between.
    let value = |i: usize| match i {
        0 => "patches".into(),
        n if n == last => "cells".into(),
        n => format!("value{n:02}"),
    };
    for (k, step) in graph.steps.iter().enumerate() {
        add_step(&mut nodes, graph.convolutions, step, &value(k + 1), value);
    }
    add_probability(&mut nodes, &mut initializers, weights);
    let calibration = &weights.meta.calibration;
    let model = OnnxModel {
        ir_version: IR_VERSION,
        producer_name: env!("CARGO_PKG_NAME").into(),
        producer_version: env!("CARGO_PKG_VERSION").into(),
        graph: Some(OnnxGraph {
            node: nodes,
            name: "dots".into(),
            initializer: initializers,
            input: vec![ValueInfo::floats("patches", 1, SIZE)],
            output: vec![
                ValueInfo::floats("cells", weights.meta.head.channels(), CELLS),
                ValueInfo::floats("probability", 1, CELLS),
            ],
        }),
        opset_import: vec![OperatorSet { version: OPERATORS }],
        metadata_props: vec![
            NodeEntry::new("slope", calibration.slope),
            NodeEntry::new("offset", calibration.offset),
            NodeEntry::new("covariance_factor", calibration.covariance_factor),
        ],
    };
    model.encode_to_vec()
}

/// Adds the nodes of a step whose result is called `out`; `value` names the values.
fn add_step(
    nodes: &mut Vec<Node>,
    convolutions: &[Convolution],
    step: &Step,
    out: &str,
    value: impl Fn(usize) -> String,
) {
    match *step {
        Step::Convolve {
            convolution,
            of,
            relu,
        } => {
            let c = convolutions[convolution];
            let (kernel, stride, pad) = (c.kernel as i64, c.stride as i64, (c.kernel / 2) as i64);
            let raw = if relu {
                format!("{out}_raw")
            } else {
                out.to_owned()
            };
            let inputs = [
                value(of),
                format!("weight{convolution:02}"),
                format!("bias{convolution:02}"),
            ];
            let mut node = Node::new("Conv", &inputs, &raw);
            node.attribute = vec![
                Attribute::ints("kernel_shape", &[kernel; 2]),
                Attribute::ints("strides", &[stride; 2]),
                Attribute::ints("pads", &[pad; 4]),
            ];
            nodes.push(node);
            if relu {
                nodes.push(Node::new("Relu", &[raw], out));
            }
        }
        Step::Upsample { of } => {
            let inputs = [value(of), String::new(), "double".into()];
            let mut node = Node::new("Resize", &inputs, out);
            node.attribute = vec![
                Attribute::string("mode", "nearest"),
                Attribute::string("coordinate_transformation_mode", "asymmetric"),
                Attribute::string("nearest_mode", "floor"),
            ];
            nodes.push(node);
        }
        Step::Add { a, b } => nodes.push(Node::new("Add", &[value(a), value(b)], out)),
    }
}

fn add_probability(nodes: &mut Vec<Node>, initializers: &mut Vec<Tensor>, weights: &Weights) {
    let calibration = &weights.meta.calibration;
    initializers.push(Tensor::integers("first", &[0]));
    initializers.push(Tensor::integers("second", &[1]));
    initializers.push(Tensor::integers("channels", &[1]));
    initializers.push(Tensor::floats("slope", &[1], &[calibration.slope as f32]));
    initializers.push(Tensor::floats("offset", &[1], &[calibration.offset as f32]));
    let named = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>();
    let slice = named(&["cells", "first", "second", "channels"]);
    nodes.push(Node::new("Slice", &slice, "heat"));
    nodes.push(Node::new("Mul", &named(&["heat", "slope"]), "scaled"));
    nodes.push(Node::new("Add", &named(&["scaled", "offset"]), "odds"));
    nodes.push(Node::new("Sigmoid", &named(&["odds"]), "probability"));
}

// onnx.proto is of the second version of the language, where repeated numbers are not packed unless
// it says so: strict readers refuse packed ones.

#[derive(Clone, PartialEq, Message)]
struct OnnxModel {
    #[prost(int64, tag = "1")]
    ir_version: i64,
    #[prost(string, tag = "2")]
    producer_name: String,
    #[prost(string, tag = "3")]
    producer_version: String,
    #[prost(message, optional, tag = "7")]
    graph: Option<OnnxGraph>,
    #[prost(message, repeated, tag = "8")]
    opset_import: Vec<OperatorSet>,
    #[prost(message, repeated, tag = "14")]
    metadata_props: Vec<NodeEntry>,
}

#[derive(Clone, PartialEq, Message)]
struct OperatorSet {
    #[prost(int64, tag = "2")]
    version: i64,
}

#[derive(Clone, PartialEq, Message)]
struct NodeEntry {
    #[prost(string, tag = "1")]
    key: String,
    #[prost(string, tag = "2")]
    value: String,
}

impl NodeEntry {
    fn new(key: &str, value: f64) -> Self {
        Self {
            key: key.into(),
            value: value.to_string(),
        }
    }
}

#[derive(Clone, PartialEq, Message)]
struct OnnxGraph {
    #[prost(message, repeated, tag = "1")]
    node: Vec<Node>,
    #[prost(string, tag = "2")]
    name: String,
    #[prost(message, repeated, tag = "5")]
    initializer: Vec<Tensor>,
    #[prost(message, repeated, tag = "11")]
    input: Vec<ValueInfo>,
    #[prost(message, repeated, tag = "12")]
    output: Vec<ValueInfo>,
}

#[derive(Clone, PartialEq, Message)]
struct Node {
    #[prost(string, repeated, tag = "1")]
    input: Vec<String>,
    #[prost(string, repeated, tag = "2")]
    output: Vec<String>,
    #[prost(string, tag = "3")]
    name: String,
    #[prost(string, tag = "4")]
    op_type: String,
    #[prost(message, repeated, tag = "5")]
    attribute: Vec<Attribute>,
}

impl Node {
    fn new(op_type: &str, input: &[String], output: &str) -> Self {
        Self {
            input: input.to_vec(),
            output: vec![output.into()],
            name: format!("make_{output}"),
            op_type: op_type.into(),
            attribute: Vec::new(),
        }
    }
}

#[derive(Clone, PartialEq, Message)]
struct Attribute {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(bytes = "vec", tag = "4")]
    s: Vec<u8>,
    #[prost(int64, repeated, packed = "false", tag = "8")]
    ints: Vec<i64>,
    /// 3: a string, 7: integers.
    #[prost(int32, tag = "20")]
    kind: i32,
}

impl Attribute {
    fn ints(name: &str, values: &[i64]) -> Self {
        Self {
            name: name.into(),
            s: Vec::new(),
            ints: values.to_vec(),
            kind: 7,
        }
    }

    fn string(name: &str, text: &str) -> Self {
        Self {
            name: name.into(),
            s: text.into(),
            ints: Vec::new(),
            kind: 3,
        }
    }
}

#[derive(Clone, PartialEq, Message)]
struct Tensor {
    #[prost(int64, repeated, packed = "false", tag = "1")]
    dims: Vec<i64>,
    #[prost(int32, tag = "2")]
    data_type: i32,
    #[prost(string, tag = "8")]
    name: String,
    /// Little endian.
    #[prost(bytes = "vec", tag = "9")]
    raw_data: Vec<u8>,
}

impl Tensor {
    fn floats(name: &str, dims: &[i64], values: &[f32]) -> Self {
        Self {
            dims: dims.to_vec(),
            data_type: FLOAT,
            name: name.into(),
            raw_data: values.iter().flat_map(|x| x.to_le_bytes()).collect(),
        }
    }

    fn integers(name: &str, values: &[i64]) -> Self {
        Self {
            dims: vec![values.len() as i64],
            data_type: INT64,
            name: name.into(),
            raw_data: values.iter().flat_map(|x| x.to_le_bytes()).collect(),
        }
    }
}

#[derive(Clone, PartialEq, Message)]
struct ValueInfo {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(message, optional, tag = "2")]
    kind: Option<Type>,
}

#[derive(Clone, PartialEq, Message)]
struct Type {
    #[prost(message, optional, tag = "1")]
    tensor: Option<TensorType>,
}

#[derive(Clone, PartialEq, Message)]
struct TensorType {
    #[prost(int32, tag = "1")]
    element: i32,
    #[prost(message, optional, tag = "2")]
    shape: Option<TensorShape>,
}

#[derive(Clone, PartialEq, Message)]
struct TensorShape {
    #[prost(message, repeated, tag = "1")]
    dim: Vec<Dimension>,
}

#[derive(Clone, PartialEq, Message)]
struct Dimension {
    #[prost(int64, optional, tag = "1")]
    length: Option<i64>,
    /// The name of a length that is free.
    #[prost(string, optional, tag = "2")]
    free: Option<String>,
}

impl ValueInfo {
    /// A batch of square maps.
    fn floats(name: &str, channels: usize, side: usize) -> Self {
        let fixed = |n: usize| Dimension {
            length: Some(n as i64),
            free: None,
        };
        let batch = Dimension {
            length: None,
            free: Some("n".into()),
        };
        Self {
            name: name.into(),
            kind: Some(Type {
                tensor: Some(TensorType {
                    element: FLOAT,
                    shape: Some(TensorShape {
                        dim: vec![batch, fixed(channels), fixed(side), fixed(side)],
                    }),
                }),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeated_numbers_are_not_packed() {
        // A field's number times 8, plus 0 for a plain integer; packed ones would have 2 and a
        // length.
        let tensor = Tensor::integers("", &[5, 6]);
        assert!(tensor.encode_to_vec().starts_with(&[8, 2]));
        let ints = Attribute::ints("", &[3, 4]).encode_to_vec();
        assert!(ints.windows(4).any(|w| w == [64, 3, 64, 4]), "{ints:?}");
    }
}
