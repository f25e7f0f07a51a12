#include "zoltan_rcb.hpp"

#include "mpm_hpc/base/error.hpp"

#ifdef MPM_WITH_ZOLTAN

#include <zoltan.h>

#include <string>

#include "mpm_hpc/parallel/mpi_handle.hpp"

namespace mpm {

namespace {

using Points = std::vector<WeightedPoint>;
const Points& points_of(void* data) { return *static_cast<const Points*>(data); }

int count_points(void* data, int* error) {
  *error = ZOLTAN_OK;
  return static_cast<int>(points_of(data).size());
}
void list_points(void* data, int, int, ZOLTAN_ID_PTR global, ZOLTAN_ID_PTR local, int, float* weights,
                 int* error) {
  *error = ZOLTAN_OK;
  for (std::size_t i = 0; i < points_of(data).size(); ++i) {
    global[i] = points_of(data)[i].id;
    local[i] = static_cast<ZOLTAN_ID_TYPE>(i);
    weights[i] = points_of(data)[i].weight;
  }
}
int count_directions(void*, int* error) {
  *error = ZOLTAN_OK;
  return 3;
}
void list_places(void* data, int, int, int count, ZOLTAN_ID_PTR, ZOLTAN_ID_PTR local, int, double* places,
                 int* error) {
  *error = ZOLTAN_OK;
  for (int i = 0; i < count; ++i)
    for (int a = 0; a < 3; ++a) places[3 * i + a] = points_of(data)[local[i]].place[a];
}

void check(int code) { debug_check(code == ZOLTAN_OK || code == ZOLTAN_WARN, "Zoltan failed"); }

}  // namespace

bool ZoltanRcb::available() { return true; }

ZoltanRcb::ZoltanRcb(const Communicator& communicator, int parts, bool reuse) {
  float version = 0;
  check(Zoltan_Initialize(0, nullptr, &version));
  Zoltan_Struct* zoltan = Zoltan_Create(mpi_comm(communicator));
  handle_ = zoltan;
  const std::pair<const char*, std::string> settings[] = {{"DEBUG_LEVEL", "0"},
                                                          {"LB_METHOD", "RCB"},
                                                          {"NUM_GID_ENTRIES", "1"},
                                                          {"NUM_LID_ENTRIES", "1"},
                                                          {"OBJ_WEIGHT_DIM", "1"},
                                                          {"NUM_GLOBAL_PARTS", std::to_string(parts)},
                                                          {"IMBALANCE_TOL", "1.01"},
                                                          {"RETURN_LISTS", "PARTS"},
                                                          {"KEEP_CUTS", reuse ? "1" : "0"},
                                                          {"RCB_REUSE", reuse ? "1" : "0"}};
  for (const auto& [name, value] : settings) check(Zoltan_Set_Param(zoltan, name, value.c_str()));
}

ZoltanRcb::~ZoltanRcb() {
  Zoltan_Struct* zoltan = static_cast<Zoltan_Struct*>(handle_);
  Zoltan_Destroy(&zoltan);
}

std::vector<int> ZoltanRcb::partition(const std::vector<WeightedPoint>& points) {
  Zoltan_Struct* zoltan = static_cast<Zoltan_Struct*>(handle_);
  void* data = const_cast<Points*>(&points);
  check(Zoltan_Set_Num_Obj_Fn(zoltan, count_points, data));
  check(Zoltan_Set_Obj_List_Fn(zoltan, list_points, data));
  check(Zoltan_Set_Num_Geom_Fn(zoltan, count_directions, nullptr));
  check(Zoltan_Set_Geom_Multi_Fn(zoltan, list_places, data));
  int changes, global_size, local_size, imports, exports;
  ZOLTAN_ID_PTR import_global, import_local, export_global, export_local;
  int *import_ranks, *import_parts, *export_ranks, *export_parts;
  check(Zoltan_LB_Partition(zoltan, &changes, &global_size, &local_size, &imports, &import_global,
                            &import_local, &import_ranks, &import_parts, &exports, &export_global,
                            &export_local, &export_ranks, &export_parts));
  std::vector<int> parts(points.size());
  for (int i = 0; i < exports; ++i) parts[export_local[i]] = export_parts[i];
  Zoltan_LB_Free_Part(&import_global, &import_local, &import_ranks, &import_parts);
  Zoltan_LB_Free_Part(&export_global, &export_local, &export_ranks, &export_parts);
  return parts;
}

}  // namespace mpm

#else

namespace mpm {

bool ZoltanRcb::available() { return false; }
ZoltanRcb::ZoltanRcb(const Communicator&, int, bool) {}
ZoltanRcb::~ZoltanRcb() = default;
std::vector<int> ZoltanRcb::partition(const std::vector<WeightedPoint>&) {
  debug_check(false, "the benchmark was built without Zoltan");
  return {};
}

}  // namespace mpm

#endif
