// Pinocchio as a C++ user calls it: a model built from arrays, the regressor of many samples, single calls of RNEA and ABA.
//
// Everything is instantiated here from the headers, so that the flags of this build apply to all of it.  The caller
// times nothing: the loops are timed here, and Python costs nothing.

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/regressor.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/multibody.hpp>

namespace {

using Clock = std::chrono::steady_clock;
using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using ConstVector = Eigen::Map<const Eigen::VectorXd>;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

struct Robot {
  pinocchio::Model model;
  std::vector<std::unique_ptr<pinocchio::Data>> data;  // one for every thread, made once as a user would

  pinocchio::Data &of_thread(int k) {
    while (static_cast<int>(data.size()) <= k) data.push_back(std::make_unique<pinocchio::Data>(model));
    return *data[k];
  }
};

struct States {
  const double *q, *v, *a;
};

// The regressor lives in column order inside Pinocchio; `w` is the caller's matrix in rows, or null to leave it there.
void fill(const pinocchio::Model &model, pinocchio::Data &data, States s, std::int64_t from, std::int64_t to, double *w) {
  const std::int64_t nq = model.nq, nv = model.nv, columns = 10 * (model.njoints - 1);
  for (std::int64_t i = from; i < to; ++i) {
    const ConstVector q(s.q + i * nq, nq), v(s.v + i * nv, nv), a(s.a + i * nv, nv);
    pinocchio::computeJointTorqueRegressor(model, data, q, v, a);
    if (w) Eigen::Map<Rows>(w + i * nv * columns, nv, columns) = data.jointTorqueRegressor;
  }
}

}  // namespace

extern "C" {

// Joints in order: parent (0 the world), kind ("RX" ... "PZ", "RU" and "PU" about an axis, "FF"), axis, placement as
// rotation by rows and translation, mass, centre of mass, inertia about it by rows.
void *anchor_robot(int joints, const int *parent, const char *const *kind, const double *axis, const double *placement,
                   const double *inertia) {
  using namespace pinocchio;
  auto robot = std::make_unique<Robot>();
  robot->model.gravity.linear() = Eigen::Vector3d(0, 0, -9.81);
  for (int k = 0; k < joints; ++k) {
    const double *p = placement + 12 * k, *m = inertia + 13 * k;
    const SE3 place(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(p), Eigen::Map<const Eigen::Vector3d>(p + 9));
    const Eigen::Vector3d along = Eigen::Map<const Eigen::Vector3d>(axis + 3 * k);
    const std::string name = kind[k];
    JointModel joint;
    if (name == "RX") joint = JointModelRX();
    else if (name == "RY") joint = JointModelRY();
    else if (name == "RZ") joint = JointModelRZ();
    else if (name == "PX") joint = JointModelPX();
    else if (name == "PY") joint = JointModelPY();
    else if (name == "PZ") joint = JointModelPZ();
    else if (name == "RU") joint = JointModelRevoluteUnaligned(along);
    else if (name == "PU") joint = JointModelPrismaticUnaligned(along);
    else if (name == "FF") joint = JointModelFreeFlyer();
    else return nullptr;
    const auto index = robot->model.addJoint(parent[k], joint, place, "joint" + std::to_string(k));
    const Eigen::Matrix3d about = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(m + 4);
    robot->model.appendBodyToJoint(index, Inertia(m[0], Eigen::Map<const Eigen::Vector3d>(m + 1), about), SE3::Identity());
  }
  return robot.release();
}

void anchor_free(void *robot) { delete static_cast<Robot *>(robot); }

// Seconds to fill W, (count, nv, columns) by rows; with w null, seconds to compute only.
double anchor_regressor(void *handle, std::int64_t count, const double *q, const double *v, const double *a, double *w,
                        int threads) {
  auto &robot = *static_cast<Robot *>(handle);
  for (int k = 0; k < threads; ++k) robot.of_thread(k);
  const States states{q, v, a};
  const auto start = Clock::now();
  if (threads == 1) {
    fill(robot.model, *robot.data[0], states, 0, count, w);
  } else {
    std::vector<std::thread> pool;
    for (int k = 0; k < threads; ++k)
      pool.emplace_back([&, k] {
        fill(robot.model, *robot.data[k], states, count * k / threads, count * (k + 1) / threads, w);
      });
    for (auto &thread : pool) thread.join();
  }
  return seconds_since(start);
}

// Seconds for `rounds` passes of single calls over an array of states.
double anchor_rnea(void *handle, std::int64_t count, const double *q, const double *v, const double *a, double *torques,
                   std::int64_t rounds) {
  auto &robot = *static_cast<Robot *>(handle);
  auto &data = robot.of_thread(0);
  const std::int64_t nq = robot.model.nq, nv = robot.model.nv;
  const auto start = Clock::now();
  for (std::int64_t round = 0; round < rounds; ++round)
    for (std::int64_t i = 0; i < count; ++i)
      Eigen::Map<Eigen::VectorXd>(torques + i * nv, nv) = pinocchio::rnea(
          robot.model, data, ConstVector(q + i * nq, nq), ConstVector(v + i * nv, nv), ConstVector(a + i * nv, nv));
  return seconds_since(start);
}

// The same for accelerations by articulated bodies.
double anchor_aba(void *handle, std::int64_t count, const double *q, const double *v, const double *torques,
                  double *accelerations, std::int64_t rounds) {
  auto &robot = *static_cast<Robot *>(handle);
  auto &data = robot.of_thread(0);
  const std::int64_t nq = robot.model.nq, nv = robot.model.nv;
  const auto start = Clock::now();
  for (std::int64_t round = 0; round < rounds; ++round)
    for (std::int64_t i = 0; i < count; ++i)
      Eigen::Map<Eigen::VectorXd>(accelerations + i * nv, nv) = pinocchio::aba(
          robot.model, data, ConstVector(q + i * nq, nq), ConstVector(v + i * nv, nv), ConstVector(torques + i * nv, nv));
  return seconds_since(start);
}

}  // extern "C"
