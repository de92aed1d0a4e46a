//! Running ONNX graphs, with `rten`: nothing else of this program names it.

use std::cell::Cell;
use std::fmt;
use std::panic::{self, AssertUnwindSafe};
use std::sync::{Arc, LazyLock, Once};

use rten::{
    DataType, Dimension, LoadErrorKind, ModelOptions, NodeId, OpRegistry, RunOptions, ThreadPool, Value,
    ValueType, op_types,
};

use super::{Port, wire};

/// A graph that can be run.
pub(super) struct Runtime {
    model: rten::Model,
    inputs: Vec<Port>,
    outputs: Vec<Port>,
}

impl Runtime {
    /// The graph in the content of an ONNX file.
    pub fn load(bytes: Vec<u8>) -> Result<Runtime, String> {
        wire::check(&bytes)?;
        let loaded = guarded(|| {
            ModelOptions::with_ops(operators()).load(bytes).map_err(|error| match error.kind() {
                LoadErrorKind::ExternalDataError => {
                    "its weights are in another file; export it with them (`torch.onnx.export(.., external_data=False)`)".to_owned()
                }
                _ => words(&error.to_string()),
            })
        });
        let model = loaded?;
        let ports = |ids: &[NodeId]| ids.iter().map(|id| port(&model, *id)).collect();
        Ok(Runtime { inputs: ports(model.input_ids()), outputs: ports(model.output_ids()), model })
    }

    pub fn inputs(&self) -> &[Port] {
        &self.inputs
    }

    pub fn outputs(&self) -> &[Port] {
        &self.outputs
    }

    /// Runs it on each of `rows`: `inputs` are `[rows, values]` in the order of its own, and of each row `take` is given its
    /// outputs. Rows never meet, so that none depends on those beside it.
    pub fn run(
        &self,
        rows: usize,
        inputs: &[Vec<f32>],
        mut take: impl FnMut(usize, &[Vec<f32>]) -> Result<(), String> + Send,
    ) -> Result<(), String> {
        let options = RunOptions::default().with_thread_pool(Some(POOL.clone()));
        let (ids, outputs) = (self.model.input_ids(), self.model.output_ids());
        guarded(|| {
            for row in 0..rows {
                let values = ids.iter().zip(&self.inputs).zip(inputs).map(|((id, port), values)| {
                    let width = values.len() / rows;
                    port.value(&values[row * width..(row + 1) * width]).map(|value| (*id, value.into()))
                });
                let values = values.collect::<Result<_, String>>()?;
                let said = self.model.run(values, outputs, Some(options.clone()));
                let said = said.map_err(|error| words(&error.to_string()))?;
                let said: Vec<Vec<f32>> = said.into_iter().map(numbers).collect::<Result<_, _>>()?;
                take(row, &said)?;
            }
            Ok(())
        })
    }
}

impl Port {
    /// Of this shape, one where a size is left open.
    fn value(&self, values: &[f32]) -> Result<Value, String> {
        let shape = &self.shape[..];
        let value = if self.whole {
            let whole = values.iter().map(|value| *value as i32).collect();
            Value::from_shape(shape, whole).map_err(|error| error.to_string())
        } else {
            Value::from_shape(shape, values.to_vec()).map_err(|error| error.to_string())
        };
        value.map_err(|error| format!("its input `{}`: {error}", self.name))
    }
}

/// What the graph says of an input or output.
fn port(model: &rten::Model, id: NodeId) -> Port {
    let about = model.node_info(id);
    let size = |dimension: &Dimension| match dimension {
        Dimension::Fixed(size) => *size,
        Dimension::Symbolic(_) => 1,
    };
    let shape = about.as_ref().and_then(|about| about.shape()).unwrap_or_default();
    Port {
        name: about.as_ref().and_then(|about| about.name()).unwrap_or_default().to_owned(),
        shape: shape.iter().map(size).collect(),
        whole: about.and_then(|about| about.dtype()) == Some(ValueType::Tensor(DataType::Int32)),
    }
}

fn numbers(value: Value) -> Result<Vec<f32>, String> {
    match value {
        Value::FloatTensor(tensor) => Ok(tensor.into_data()),
        Value::Int32Tensor(tensor) => Ok(tensor.into_data().into_iter().map(|value| value as f32).collect()),
        _ => Err("an output is neither of f32 nor of whole numbers".to_owned()),
    }
}

/// On one line, as part of an error of ours.
fn words(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").replace("error: ", "error, ")
}

/// The operators of policies. Without those that only models of images, sound or text use: what is not here cannot go wrong.
fn operators() -> OpRegistry {
    use op_types::*;
    OpRegistry::with_ops(&[
        &Abs,
        &Add,
        &And,
        &ArgMax,
        &ArgMin,
        &BatchNormalization,
        &Cast,
        &CastLike,
        &Ceil,
        &Clip,
        &Concat,
        &ConstantOfShape,
        &Cos,
        &Div,
        &Elu,
        &Equal,
        &Erf,
        &Exp,
        &Expand,
        &Flatten,
        &Floor,
        &GRU,
        &Gather,
        &GatherElements,
        &Gelu,
        &Gemm,
        &Greater,
        &GreaterOrEqual,
        &HardSigmoid,
        &HardSwish,
        &Identity,
        &LSTM,
        &LayerNormalization,
        &LeakyRelu,
        &Less,
        &LessOrEqual,
        &Log,
        &LogSoftmax,
        &MatMul,
        &Max,
        &Mean,
        &Min,
        &Mod,
        &Mul,
        &Neg,
        &Not,
        &Or,
        &PRelu,
        &Pow,
        &Reciprocal,
        &ReduceL2,
        &ReduceMax,
        &ReduceMean,
        &ReduceMin,
        &ReduceSum,
        &ReduceSumSquare,
        &Relu,
        &Reshape,
        &Round,
        &SequenceAt,
        &Shape,
        &Sigmoid,
        &Sign,
        &Sin,
        &Size,
        &Slice,
        &Softmax,
        &Softplus,
        &Split,
        &SplitToSequence,
        &Sqrt,
        &Squeeze,
        &Sub,
        &Sum,
        &Tanh,
        &Tile,
        &Transpose,
        &Trilu,
        &Unsqueeze,
        &Where,
        &Xor,
    ])
}

/// The library computes on threads of a pool. One is enough for a policy, and a number of its own, whatever the machine,
/// keeps results alike.
static POOL: LazyLock<Arc<ThreadPool>> = LazyLock::new(|| Arc::new(ThreadPool::with_num_threads(1)));

/// Does `work` on the thread of the pool.
pub(in crate::nn) fn at_home<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    POOL.run(work)
}

thread_local! {
    /// Whether a panic on this thread is caught, and told as an error.
    static IS_GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// What `work` comes to in the library's own pool, or how it panicked: a graph is outside input, and the library trusts some of
/// what it says.
fn guarded<T: Send>(work: impl FnOnce() -> Result<T, String> + Send) -> Result<T, String> {
    static SILENCER: Once = Once::new();
    SILENCER.call_once(|| {
        let others = panic::take_hook();
        panic::set_hook(Box::new(move |panic| {
            if !IS_GUARDED.get() {
                others(panic);
            }
        }));
    });
    let work = || {
        IS_GUARDED.set(true);
        let done = panic::catch_unwind(AssertUnwindSafe(work));
        IS_GUARDED.set(false);
        done
    };
    POOL.run(work).unwrap_or_else(|panic| {
        let said = panic.downcast_ref::<String>().map(String::as_str);
        let said = said.or_else(|| panic.downcast_ref::<&str>().copied());
        Err(format!("the graph makes no sense ({})", words(said.unwrap_or("the library gave up"))))
    })
}

impl fmt::Debug for Runtime {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        self.model.fmt(f)
    }
}
