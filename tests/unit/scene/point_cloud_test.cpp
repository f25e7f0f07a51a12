#include "mpm_hpc/scene/point_cloud.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "mpm_hpc/base/error.hpp"
#include "support/temporary_folder.hpp"

namespace mpm {
namespace {

class PointCloudCsv : public ::testing::Test {
 protected:
  std::filesystem::path write(const std::string& content) {
    std::ofstream(folder_ / "cloud.csv") << content;
    return folder_ / "cloud.csv";
  }
  template <int Dim>
  std::string fault(const std::string& content) {
    const std::string file = write(content).string();
    try {
      read_point_cloud_csv<Dim>(file);
    } catch (const UserError& error) {
      const std::string what = error.what();
      return what.rfind(file, 0) == 0 ? "cloud.csv" + what.substr(file.size()) : what;
    }
    return "accepted";
  }
  test::TemporaryFolder folder_;
};

TEST_F(PointCloudCsv, ReadsColumnsInAnyOrderWithUnits) {
  const auto cloud = read_point_cloud_csv<2>(
      write("# made by hand\n\ny [mm], x, volume [mm^2], vx, vy, F_xx, F_xy, F_yx, F_yy\r\n"
            "1, 2, 3, 4, 5, 1, 0.1, 0.2, 1 # the first\n\n-1,+2e-1,0.5,0,0,2,0,0,2\n"));
  ASSERT_EQ(cloud.positions.size(), 2u);
  EXPECT_EQ(cloud.total, 2);
  EXPECT_DOUBLE_EQ(cloud.positions[0].x(), 2);
  EXPECT_DOUBLE_EQ(cloud.positions[0].y(), 1e-3);
  EXPECT_DOUBLE_EQ(cloud.positions[1].x(), 0.2);
  EXPECT_EQ(cloud.velocities[0], Vec<2>(4, 5));
  EXPECT_DOUBLE_EQ(cloud.volumes[0], 3e-6);
  EXPECT_EQ(cloud.deformation_gradients[0](0, 1), 0.1);
  EXPECT_EQ(cloud.deformation_gradients[0](1, 0), 0.2);
  const auto bare = read_point_cloud_csv<3>(write("x,y,z\n1,2,3"));
  EXPECT_EQ(bare.positions[0], Vec<3>(1, 2, 3));
  EXPECT_TRUE(bare.velocities.empty() && bare.volumes.empty() && bare.deformation_gradients.empty());
}

TEST_F(PointCloudCsv, PartsJoinToTheWhole) {
  std::string content = "x,y,volume\n";
  for (int i = 0; i < 11; ++i) content += fmt::format("{},{},1\n", i, 2 * i);
  const auto file = write(content);
  const auto whole = read_point_cloud_csv<2>(file);
  for (int parts : {1, 2, 3, 7, 13}) {
    std::vector<Vec<2>> joined;
    for (int part = 0; part < parts; ++part) {
      const auto share = read_point_cloud_csv<2>(file, part, parts);
      EXPECT_EQ(share.total, 11);
      joined.insert(joined.end(), share.positions.begin(), share.positions.end());
    }
    EXPECT_EQ(joined, whole.positions) << parts;
  }
}

TEST_F(PointCloudCsv, ErrorsNameTheLine) {
  EXPECT_EQ(fault<2>("x,y,vulome\n"), "cloud.csv:1: unknown column \"vulome\"; did you mean \"volume\"?");
  EXPECT_EQ(fault<2>("x,y,z\n1,2,3\n").rfind("cloud.csv:1: unknown column \"z\"", 0), 0u);
  EXPECT_EQ(fault<3>("x,y\n1,2\n"), "cloud.csv:1: the column \"z\" is missing; add it.");
  EXPECT_EQ(fault<2>("x,y,vx\n1,2,3\n"), "cloud.csv:1: the column \"vy\" is missing; add it.");
  EXPECT_EQ(fault<2>("x,y,x\n1,2,3\n"), "cloud.csv:1: the column \"x\" appears twice; remove one.");
  EXPECT_EQ(fault<2>("x [s],y\n1,2\n"), "cloud.csv:1: column \"x\" is given in [s], but m is expected.");
  EXPECT_EQ(fault<2>("x,y\n1,2\n\n3\n"),
            "cloud.csv:4: the row has 1 values, but the header names 2 columns.");
  EXPECT_EQ(fault<2>("x,y\n1,2\n3,abc\n"), "cloud.csv:3: \"abc\" in column \"y\" is no finite number.");
  EXPECT_EQ(fault<2>("x,y\n1,nan\n"), "cloud.csv:2: \"nan\" in column \"y\" is no finite number.");
  EXPECT_EQ(fault<2>("x,y,volume\n1,2,0\n"), "cloud.csv:2: the volume 0 must be positive.");
  EXPECT_EQ(fault<2>("x,y,F_xx,F_xy,F_yx,F_yy\n1,2,0,1,1,0\n"),
            "cloud.csv:2: the determinant of F is -1, it must be positive.");
  EXPECT_EQ(fault<2>("x,y\n"), "cloud.csv: the file has a header but no particles; add rows.");
  EXPECT_EQ(fault<2>(""), "cloud.csv:1: the point cloud is empty; it needs a header such as x,y,z,volume.");
  EXPECT_THROW(read_point_cloud_csv<2>("no/such/cloud.csv"), UserError);
}

}  // namespace
}  // namespace mpm
