//! The convolutions of the network: names, channels, kernels, and inputs.
//!
//! Input channels follow from the layers before, so a plan with other output channels is a network too.

/// One convolution.
#[derive(Debug, Clone)]
pub(super) struct LayerPlan {
    /// Name within the block.
    pub(super) name: &'static str,
    pub(super) outputs: usize,
    /// Height and width.
    pub(super) kernel: [usize; 2],
    pub(super) stride: usize,
    /// Rows above and below, columns left and right.
    pub(super) padding: [usize; 2],
}

/// Pooling at the beginning of a branch, over squares of 3x3 pixels.
#[derive(Debug, Clone, Copy)]
pub(super) enum Pool {
    /// The mean around each pixel, over the pixels inside the image.
    Mean,
    /// The largest value around each pixel.
    Largest,
    /// The largest value of squares inside the image, in steps of 2.
    LargestOfEverySecond,
}

/// Plan of a [`Branch`](super::Branch).
#[derive(Debug, Clone)]
pub(super) struct BranchPlan {
    pub(super) pool: Option<Pool>,
    pub(super) chain: Vec<LayerPlan>,
    pub(super) fork: Vec<LayerPlan>,
}

/// Plan of a [`Block`](super::Block).
#[derive(Debug, Clone)]
pub(super) struct BlockPlan {
    /// Beginning of the names of its tensors; empty in the stem.
    pub(super) name: &'static str,
    pub(super) branches: Vec<BranchPlan>,
}

/// All blocks between the image and its features.
pub(super) fn network() -> Vec<BlockPlan> {
    let mut blocks = stem();
    blocks.extend([
        block_a("Mixed_5b", 32),
        block_a("Mixed_5c", 64),
        block_a("Mixed_5d", 64),
        block_b("Mixed_6a"),
        block_c("Mixed_6b", 128),
        block_c("Mixed_6c", 160),
        block_c("Mixed_6d", 160),
        block_c("Mixed_6e", 192),
        block_d("Mixed_7a"),
        block_e("Mixed_7b", Pool::Mean),
        block_e("Mixed_7c", Pool::Largest),
    ]);
    blocks
}

/// Three blocks of one branch each, the last one without a convolution.
pub(super) fn stem() -> Vec<BlockPlan> {
    let first = vec![
        inside("Conv2d_1a_3x3", 32, 2),
        inside("Conv2d_2a_3x3", 32, 1),
        same("Conv2d_2b_3x3", 64, [3, 3]),
    ];
    let second = vec![same("Conv2d_3b_1x1", 80, [1, 1]), inside("Conv2d_4a_3x3", 192, 1)];
    let branches = [chain(first), halved(second), halved(Vec::new())];
    let block = |branch| BlockPlan {
        name: "",
        branches: vec![branch],
    };
    branches.into_iter().map(block).collect()
}

fn block_a(name: &'static str, pooled: usize) -> BlockPlan {
    let branches = vec![
        chain(vec![same("branch1x1", 64, [1, 1])]),
        chain(vec![
            same("branch5x5_1", 48, [1, 1]),
            same("branch5x5_2", 64, [5, 5]),
        ]),
        chain(vec![
            same("branch3x3dbl_1", 64, [1, 1]),
            same("branch3x3dbl_2", 96, [3, 3]),
            same("branch3x3dbl_3", 96, [3, 3]),
        ]),
        around(Pool::Mean, pooled),
    ];
    BlockPlan { name, branches }
}

fn block_b(name: &'static str) -> BlockPlan {
    let branches = vec![
        chain(vec![inside("branch3x3", 384, 2)]),
        chain(vec![
            same("branch3x3dbl_1", 64, [1, 1]),
            same("branch3x3dbl_2", 96, [3, 3]),
            inside("branch3x3dbl_3", 96, 2),
        ]),
        halved(Vec::new()),
    ];
    BlockPlan { name, branches }
}

fn block_c(name: &'static str, narrow: usize) -> BlockPlan {
    let branches = vec![
        chain(vec![same("branch1x1", 192, [1, 1])]),
        chain(vec![
            same("branch7x7_1", narrow, [1, 1]),
            same("branch7x7_2", narrow, [1, 7]),
            same("branch7x7_3", 192, [7, 1]),
        ]),
        chain(vec![
            same("branch7x7dbl_1", narrow, [1, 1]),
            same("branch7x7dbl_2", narrow, [7, 1]),
            same("branch7x7dbl_3", narrow, [1, 7]),
            same("branch7x7dbl_4", narrow, [7, 1]),
            same("branch7x7dbl_5", 192, [1, 7]),
        ]),
        around(Pool::Mean, 192),
    ];
    BlockPlan { name, branches }
}

fn block_d(name: &'static str) -> BlockPlan {
    let branches = vec![
        chain(vec![
            same("branch3x3_1", 192, [1, 1]),
            inside("branch3x3_2", 320, 2),
        ]),
        chain(vec![
            same("branch7x7x3_1", 192, [1, 1]),
            same("branch7x7x3_2", 192, [1, 7]),
            same("branch7x7x3_3", 192, [7, 1]),
            inside("branch7x7x3_4", 192, 2),
        ]),
        halved(Vec::new()),
    ];
    BlockPlan { name, branches }
}

fn block_e(name: &'static str, pool: Pool) -> BlockPlan {
    let mut once = chain(vec![same("branch3x3_1", 384, [1, 1])]);
    once.fork = vec![
        same("branch3x3_2a", 384, [1, 3]),
        same("branch3x3_2b", 384, [3, 1]),
    ];
    let mut twice = chain(vec![
        same("branch3x3dbl_1", 448, [1, 1]),
        same("branch3x3dbl_2", 384, [3, 3]),
    ]);
    twice.fork = vec![
        same("branch3x3dbl_3a", 384, [1, 3]),
        same("branch3x3dbl_3b", 384, [3, 1]),
    ];
    let branches = vec![
        chain(vec![same("branch1x1", 320, [1, 1])]),
        once,
        twice,
        around(pool, 192),
    ];
    BlockPlan { name, branches }
}

/// A convolution that keeps height and width: pixels outside the image count as 0.
fn same(name: &'static str, outputs: usize, kernel: [usize; 2]) -> LayerPlan {
    LayerPlan {
        name,
        outputs,
        kernel,
        stride: 1,
        padding: kernel.map(|side| side / 2),
    }
}

/// A convolution of 3x3 whose squares lie inside the image.
fn inside(name: &'static str, outputs: usize, stride: usize) -> LayerPlan {
    LayerPlan {
        name,
        outputs,
        kernel: [3, 3],
        stride,
        padding: [0, 0],
    }
}

fn chain(chain: Vec<LayerPlan>) -> BranchPlan {
    BranchPlan {
        pool: None,
        chain,
        fork: Vec::new(),
    }
}

/// A pooling that keeps height and width, followed by one convolution.
fn around(pool: Pool, outputs: usize) -> BranchPlan {
    BranchPlan {
        pool: Some(pool),
        ..chain(vec![same("branch_pool", outputs, [1, 1])])
    }
}

fn halved(layers: Vec<LayerPlan>) -> BranchPlan {
    BranchPlan {
        pool: Some(Pool::LargestOfEverySecond),
        ..chain(layers)
    }
}

impl LayerPlan {
    /// Beginning of the names of the layer's tensors.
    pub(super) fn name_in(&self, block: &str) -> String {
        if block.is_empty() {
            self.name.into()
        } else {
            format!("{block}.{}", self.name)
        }
    }
}

impl BlockPlan {
    /// Number of output channels for `inputs` input channels.
    pub(super) fn outputs(&self, inputs: usize) -> usize {
        self.branches.iter().map(|branch| branch.outputs(inputs)).sum()
    }
}

impl BranchPlan {
    fn outputs(&self, inputs: usize) -> usize {
        if self.fork.is_empty() {
            return self.chain.last().map_or(inputs, |layer| layer.outputs);
        }
        self.fork.iter().map(|layer| layer.outputs).sum()
    }
}
