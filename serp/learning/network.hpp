// Q-networks: small dense networks, their forward pass and their backward pass.
//
// Of sizes, F is numbers in one input, A actions, E members, B batch, P parameters of a member.
#pragma once

#include <cstddef>
#include <vector>

namespace serp {

using std::size_t;

/// Numbers that start as 0, at a multiple of 64 bytes: results must not depend on addresses.
class Floats {
public:
    explicit Floats(size_t count = 0) : lines_((count + 15) / 16) {}
    float* data() { return reinterpret_cast<float*>(lines_.data()); }
    const float* data() const { return reinterpret_cast<const float*>(lines_.data()); }

private:
    struct alignas(64) Line {
        float numbers[16] = {};
    };
    std::vector<Line> lines_;
};

/// Where a layer lies in a member's parameters: weights [inputs, outputs] from `start` on, from
/// `bias` on the bias [outputs] and, under LayerNorm, gain [outputs] and shift [outputs].
struct Layer {
    size_t start, bias, end, inputs, outputs;
    bool normalized;
};

/// What the forward pass of a batch computes in a layer, for the backward pass.
struct Activations {
    Floats z;        ///< [B, outputs], before ReLU; normalised, before gain and shift
    Floats h;        ///< [B, outputs], after ReLU, under LayerNorm only; otherwise z is overwritten
    Floats inverse;  ///< [B], the reciprocal of each row's standard deviation, under LayerNorm only
    Floats slope;    ///< [B, outputs], the gradient of the loss
};

class QNetwork;

/// Memory for a forward pass and a backward pass of one member and one batch.
class Pass {
public:
    Pass(const QNetwork& network, size_t batch);

    /// Returns the Q-values [B, A] of the last forward pass.
    const float* q() const { return layers.back().z.data(); }
    /// Returns memory [B, A] for the gradient of the loss in q, which the backward pass reads.
    float* q_gradient() { return layers.back().slope.data(); }

    size_t batch;
    std::vector<Activations> layers;
    Floats scratch;  ///< for the largest matrix of weights
};

/// One Q-network, or several of one shape side by side ("members").
///
/// Each hidden layer is followed by ReLU, and LayerNorm before it if wanted
/// (arXiv 1607.06450). All parameters are 0 at first.
class QNetwork {
public:
    /// `sizes` are F, the outputs of each hidden layer, and A.
    QNetwork(std::vector<size_t> sizes, bool layer_norm, size_t members);

    /// Computes a member's Q-values of inputs [B, F].
    void forward(size_t member, const float* inputs, Pass& pass) const;
    /// Writes the gradient [P] of a loss, after `forward` with the same inputs.
    void backward(size_t member, const float* inputs, Pass& pass, float* gradient) const;
    /// Writes the mean [B, A] of the members' Q-values of inputs [B, F].
    void mean(const float* inputs, size_t batch, float* q);
    /// Writes the Q-values [E, A] of each member for one input [F].
    void each(const float* inputs, float* q);

    const std::vector<size_t>& sizes() const { return sizes_; }
    const std::vector<Layer>& layers() const { return layers_; }
    size_t members() const { return members_; }
    size_t inputs() const { return sizes_.front(); }
    size_t actions() const { return sizes_.back(); }
    /// Returns P.
    size_t count() const { return layers_.back().end; }
    /// Returns the numbers from one member's parameters to the next one's, a multiple of 16.
    size_t stride() const { return (count() + 15) / 16 * 16; }
    float* parameters(size_t member = 0) { return parameters_.data() + member * stride(); }
    const float* parameters(size_t member = 0) const {
        return parameters_.data() + member * stride();
    }

private:
    std::vector<size_t> sizes_;
    size_t members_;
    std::vector<Layer> layers_;
    Floats parameters_;
    std::vector<Pass> kept_;  ///< of the last call of `mean` or `each`, for the next
};

}  // namespace serp
