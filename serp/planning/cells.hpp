// Cells of the state space, and their values.
#pragma once

#include <optional>
#include <vector>

#include "serp/planning/hash_table.hpp"

namespace serp {

/// Areas in the range of a fluent, see `Cells`.
inline constexpr double AREAS = 8.0;
/// Areas on either side of it that a graph may enter: the state space may have no end.
inline constexpr double MARGIN = 2.0;

/// A division of the state space. A cell holds the states whose continuous fluents lie in the same
/// bins and whose other fluents are equal.
struct Cells {
    std::vector<double> low;    ///< [F] lower ends of the ranges of what was visited
    std::vector<double> scale;  ///< [F] bins per unit; 0 for a fluent whose values are told apart
                                ///< exactly, negative for one on which nothing depends
    std::vector<double> area;   ///< [F] bins per unit of areas, which are larger than cells and
                                ///< divide continuous fluents only; 0 likewise

    /// Throws std::invalid_argument where the lengths differ.
    Cells(std::vector<double> low, std::vector<double> scale, std::vector<double> area);

    int width() const { return static_cast<int>(low.size()); }

    /// Returns the digest of the cell of a state [F].
    Digest cell_of(const double* state) const;
    /// Returns the digest of the area of a state [F].
    Digest area_of(const double* state) const;
    /// Returns whether a state [F] is close to the range of what was visited.
    bool in_range(const double* state) const;
    /// Returns the weight of another state in an interpolation, by the distance in widths of cells.
    double nearness(const double* state, const double* other) const;
};

/// The cells beside the cell of a state. Has scratch memory: one for each thread.
class CellsBeside {
public:
    explicit CellsBeside(const Cells& cells) : cells_(cells), bits_(cells.width()),
                                               before_(cells.width()) {}

    /// Sets the state [F].
    void from(const double* state);
    /// Returns the digest of the cell that lies `by` bins further in the direction of a fluent,
    /// which is divided.
    Digest digest_of(int fluent, int by) const;

private:
    const Cells& cells_;
    std::vector<std::uint64_t> bits_;  ///< [F] what is mixed into a digest
    std::vector<Digest> before_;       ///< [F] digests of the fluents before each
};

/// Distinct digests, numbered in the order in which they were added.
class DigestIndex {
public:
    void clear() { table_.clear(), digests_.clear(); }
    int size() const { return static_cast<int>(digests_.size()); }

    /// Returns the number of a digest; -1 where it is not known.
    int find(Digest digest) const {
        return table_.find(digest, [this, digest](int k) { return digests_[k] == digest; });
    }

    /// Returns the number of a digest, adding it where it is not known.
    int find_or_add(Digest digest) {
        const int number = table_.find_or_add(
            digest, size(), [this, digest](int k) { return digests_[k] == digest; },
            [this](int k) { return digests_[k]; });
        if (number == size()) digests_.push_back(digest);
        return number;
    }

private:
    HashTable table_;
    std::vector<Digest> digests_;
};

/// The values of N cells, in A areas. `at` may be called from several threads at once.
class CellValues {
public:
    /// Takes a state of every cell [N * F], and the values [N + 1] of the cells, then of states that
    /// are not known. `area_value` [A + 1] has the least value in each area, then of all; without it
    /// it is made from the others.
    /// Throws std::invalid_argument where lengths do not fit, or two states lie in one cell.
    CellValues(Cells cells, std::vector<double> states, std::vector<double> value,
               std::optional<std::vector<double>> area_value = std::nullopt);

    /// Returns the value of a state [F], interpolated between its cell and those beside it.
    ///
    /// Where its cell is not there, it is the least of those in its area, or of all: a plan looks
    /// for the best of many states, and would find the one about which the least is known.
    double at(const double* state) const;
    int width() const { return cells_.width(); }

    /// Sets the value of the cell of a state [F], if it is there; the areas keep theirs.
    void set(const double* state, double value);

    const Cells& cells() const { return cells_; }
    const std::vector<double>& states() const { return states_; }
    const std::vector<double>& value() const { return value_; }
    const std::vector<double>& area_value() const { return area_value_; }

private:
    Cells cells_;
    std::vector<double> states_, value_, area_value_;
    DigestIndex cell_index_, area_index_;
};

}  // namespace serp
