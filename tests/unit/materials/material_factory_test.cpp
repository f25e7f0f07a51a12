// Materials from a scene: keys, messages, and a law added to the list as any new law would be.
#include "mpm_hpc/materials/material_factory.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "unit/materials/law_samples.hpp"

namespace mpm::test {
namespace {

// Psi = k/2 |F - I|^2: linear springs between neighbours, neither split nor with a tangent.
template <int Dim>
struct Springs {
  static constexpr const char* name = "springs";
  static constexpr const char* doc = "linear springs";
  Real k = 0;

  void declare(Parameters& p) {
    p.real("spring_modulus", k, {.unit = "Pa", .required = true, .doc = "stiffness"});
  }

  template <class S>
  SymTensor<S, Dim> kirchhoff_stress(const Tensor<S, Dim>& F) const {
    SymTensor<S, Dim> tau = broadcast<S>(k) * left_cauchy_green(F);
    for (int i = 0; i < Dim; ++i)
      for (int j = i; j < Dim; ++j) tau(i, j) -= broadcast<S>(0.5 * k) * (F(i, j) + F(j, i));
    return tau;
  }
  template <class S>
  S energy_density(const Tensor<S, Dim>& F) const {
    const Tensor<S, Dim> H = F - Tensor<S, Dim>::identity();
    return broadcast<S>(0.5 * k) * inner(H, H);
  }
  template <class S>
  S stiffness_bound(const Tensor<S, Dim>& F) const {
    return broadcast<S>(2 * k) * row_sum_bound(left_cauchy_green(F));
  }
  template <class S>
  S wave_modulus(const Tensor<S, Dim>& F) const {
    return stiffness_bound(F);
  }
};

template <class... Laws>
LawList<Laws..., Springs<3>> with_springs(LawList<Laws...>);
using ExtendedList = decltype(with_springs(MaterialList<3>{}));

template <int Dim, class Make>
std::unique_ptr<Material<Dim>> read(const std::string& table, const Make& make) {
  Parameters parameters = Parameters::read_text("[material.glass]\n" + table, "plate.toml");
  std::unique_ptr<Material<Dim>> material;
  parameters.named_sections("material",
                            [&](Parameters& p, const std::string& name) { material = make(p, name); });
  parameters.finish();
  return material;
}
template <int Dim>
std::unique_ptr<Material<Dim>> read(const std::string& table) {
  return read<Dim>(table, make_material<Dim>);
}
std::unique_ptr<Material<3>> make_extended(Parameters& parameters, const std::string& name) {
  return make_material_among<3>(ExtendedList{}, PlasticityList<3>{}, parameters, name);
}

std::string message_of(const std::string& table) {
  try {
    read<3>(table);
  } catch (const UserError& error) {
    return error.what();
  }
  return "no error";
}

const std::string keys = "density = 2500\nyoungs_modulus = \"32 GPa\"\npoisson_ratio = 0.2\n";

TEST(MaterialFactoryTest, ReadsTheKeysOfAMaterial) {
  const auto material = read<3>("model = \"split_neo_hookean\"\nfracture_toughness = 3\n" + keys);
  EXPECT_EQ(material->name(), "glass");
  EXPECT_STREQ(material->model(), "split_neo_hookean");
  EXPECT_EQ(material->density(), 2500);
  EXPECT_EQ(material->fracture_toughness(), 3);
  EXPECT_TRUE(material->can_fracture());
  EXPECT_TRUE(material->splits_energy());
  EXPECT_TRUE(material->has_tangent());
}

TEST(MaterialFactoryTest, AMaterialWithoutToughnessCannotFracture) {
  const auto material = read<2>("model = \"neo_hookean\"\n" + keys);
  EXPECT_FALSE(material->can_fracture());
  EXPECT_LT(material->fracture_toughness(), 0);
  EXPECT_FALSE(material->splits_energy());
  EXPECT_TRUE(material->has_tangent());
}

// Wave modulus at rest: E (1 - nu) / ((1 + nu) (1 - 2 nu)), for plane strain as for a solid.
template <int Dim>
void expect_wave_modulus(const char* model) {
  const auto material = read<Dim>(std::string("model = \"") + model + "\"\n" + keys);
  alignas(64) double one[8], zero[8];
  std::fill_n(one, 8, 1.0);
  std::fill_n(zero, 8, 0.0);
  MaterialColumns<Dim, double> columns;
  for (int k = 0; k < Dim * Dim; ++k) columns.F[k] = k % (Dim + 1) == 0 ? one : zero;
  const MaterialLimits limits = material->limits(columns, 0, 8);
  const double expected = 32e9 * 0.8 / (1.2 * 0.6);
  EXPECT_NEAR(limits.wave_modulus, expected, 1e-13 * expected) << model;
  EXPECT_EQ(limits.min_jacobian, 1);
}

TEST(MaterialFactoryTest, ConstantsAreThoseOfASolidOrPlaneStrain) {
  for (const char* model : {"neo_hookean", "split_neo_hookean", "fixed_corotated", "hencky", "linear_elastic"}) {
    expect_wave_modulus<2>(model);
    expect_wave_modulus<3>(model);
  }
}

TEST(MaterialFactoryTest, RefusesWhatMakesNoSense) {
  using testing::HasSubstr;
  const std::string good = "model = \"neo_hookean\"\n" + keys;
  EXPECT_EQ(message_of(good), "no error");
  EXPECT_THAT(message_of(keys), HasSubstr("model"));
  EXPECT_THAT(message_of("model = \"neo_hokean\"\n" + keys), HasSubstr("did you mean \"neo_hookean\""));
  EXPECT_THAT(message_of(good + "fracture_toughness = 0\n"), HasSubstr("plate.toml:6"));
  EXPECT_THAT(message_of(good + "fracture_toughness = 0\n"), HasSubstr("positive fracture_toughness"));
  EXPECT_THAT(message_of(good + "hardness = 3\n"), HasSubstr("hardness"));
  const std::string start = "model = \"neo_hookean\"\ndensity = 1000\n";
  EXPECT_THAT(message_of(start + "youngs_modulus = 0\npoisson_ratio = 0.2\n"), HasSubstr("youngs_modulus"));
  EXPECT_THAT(message_of(start + "youngs_modulus = 1e9\npoisson_ratio = 0.5\n"), HasSubstr("poisson_ratio"));
  EXPECT_THAT(message_of(start + "youngs_modulus = 1e9\npoisson_ratio = -1\n"), HasSubstr("poisson_ratio"));
  EXPECT_THAT(message_of("model = \"neo_hookean\"\ndensity = 0\nyoungs_modulus = 1e9\npoisson_ratio = 0.2\n"),
              HasSubstr("density"));
}

TEST(MaterialFactoryTest, NamesTheModelsThatWouldDo) {
  const auto material = read<3>("model = \"neo_hookean\"\n" + keys);
  EXPECT_NO_THROW(require_ability(*material, MaterialAbility::tangent, "time.integrator"));
  try {
    require_ability(*material, MaterialAbility::split_energy, "effect.phase_field");
    FAIL() << "neo_hookean doesn't split its energy";
  } catch (const UserError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("plate.toml:2:"));
    EXPECT_THAT(error.what(), testing::HasSubstr("effect.phase_field"));
    EXPECT_THAT(error.what(), testing::HasSubstr("material.glass"));
    EXPECT_THAT(error.what(), testing::HasSubstr("\"split_neo_hookean\""));
    EXPECT_THAT(error.what(), testing::Not(testing::HasSubstr("\"neo_hookean\",")));
  }
}

const std::string plastic = "[material.glass.plasticity]\n";

TEST(MaterialFactoryTest, JoinsPlasticityToALaw) {
  const auto sand = read<3>("model = \"hencky\"\n" + keys + plastic + "model = \"drucker_prager\"\nfriction_angle = \"30 deg\"\n");
  EXPECT_STREQ(sand->model(), "hencky");
  EXPECT_STREQ(sand->plasticity(), "drucker_prager");
  ASSERT_EQ(sand->own_columns().size(), 1u);
  EXPECT_STREQ(sand->own_columns()[0].name, "lost_volume_strain");
  // What a rule is told to do without it has no column for.
  EXPECT_TRUE(read<3>("model = \"hencky\"\n" + keys + plastic +
                      "model = \"drucker_prager\"\nfriction_angle = 0.5\nvolume_correction = false\n")
                  ->own_columns()
                  .empty());
  const auto bread = read<2>("model = \"split_neo_hookean\"\nfracture_toughness = 1\n" + keys + plastic +
                             "model = \"nacc\"\nfriction_angle = \"45 deg\"\ninitial_plastic_volume = 0.97\n");
  EXPECT_TRUE(bread->splits_energy());
  ASSERT_EQ(bread->own_columns().size(), 1u);
  EXPECT_NEAR(bread->own_columns()[0].initial, std::log(0.97), 1e-15);
  EXPECT_EQ(bread->guards().size(), 2u);
  // Snow brings its plasticity with it.
  const auto snow = read<3>("model = \"snow\"\ncritical_stretch = 0.005\n" + keys);
  EXPECT_STREQ(snow->plasticity(), "clamped_stretches");
  EXPECT_EQ(snow->own_columns()[0].initial, 1);
  // Without plasticity there is nothing of it.
  const auto elastic = read<3>("model = \"hencky\"\n" + keys);
  EXPECT_EQ(elastic->plasticity(), nullptr);
  EXPECT_TRUE(elastic->own_columns().empty() && elastic->guards().empty());
}

TEST(MaterialFactoryTest, RefusesPlasticityThatDoesNotSuit) {
  using testing::AllOf;
  using testing::HasSubstr;
  using testing::Not;
  const auto with = [](const std::string& model, const std::string& rule) {
    return message_of("model = \"" + model + "\"\n" + keys + plastic + rule);
  };
  const std::string mises = "model = \"von_mises\"\nyield_stress = 1e6\n", cone = "model = \"drucker_prager\"\nfriction_angle = 0.5\n";
  EXPECT_EQ(with("split_neo_hookean", mises), "no error");
  EXPECT_THAT(with("neo_hookean", mises), AllOf(HasSubstr("plate.toml:7"), HasSubstr("\"von_mises\" of material.glass"),
                                                HasSubstr("model = \"neo_hookean\""),
                                                HasSubstr("\"split_neo_hookean\", \"hencky\"")));
  EXPECT_THAT(with("split_neo_hookean", cone), AllOf(HasSubstr("can carry it: \"hencky\"."), Not(HasSubstr("snow"))));
  EXPECT_THAT(with("snow", mises), HasSubstr("which has its own"));
  EXPECT_THAT(message_of("model = \"linear_fluid\"\ndensity = 1\nbulk_modulus = 1\n" + plastic + mises), HasSubstr("can carry it"));
  EXPECT_THAT(with("hencky", "model = \"von_mieses\"\n"), HasSubstr("did you mean \"von_mises\""));
  EXPECT_THAT(with("hencky", "model = \"von_mises\"\n"), HasSubstr("yield_stress"));
  EXPECT_THAT(with("hencky", "model = \"tresca\"\nyield_stress = 0\n"), HasSubstr("yield_stress"));
  EXPECT_THAT(with("hencky", mises + "hardening_modulus = -1\n"), HasSubstr("hardening_modulus"));
  EXPECT_THAT(with("hencky", "model = \"drucker_prager\"\nfriction_angle = 0\n"), HasSubstr("friction_angle"));
  EXPECT_THAT(with("hencky", "model = \"drucker_prager\"\nfriction_angle = \"90 deg\"\n"), HasSubstr("friction_angle"));
  EXPECT_THAT(with("hencky", mises + "cohesion = 1\n"), HasSubstr("cohesion"));
  const std::string nacc = "model = \"nacc\"\nfriction_angle = 0.7\n";
  EXPECT_EQ(with("split_neo_hookean", nacc), "no error");
  EXPECT_THAT(with("split_neo_hookean", nacc + "cohesion = -0.1\n"), HasSubstr("cohesion"));
  EXPECT_THAT(with("split_neo_hookean", nacc + "initial_plastic_volume = 0\n"), HasSubstr("initial_plastic_volume"));
  EXPECT_THAT(with("split_neo_hookean", nacc + "initial_plastic_volume = 1e-5\n"), HasSubstr("raise initial_plastic_volume"));
  EXPECT_THAT(with("split_neo_hookean", nacc + "return = \"other\"\n"), HasSubstr("volume_preserving"));
  EXPECT_THAT(with("fixed_corotated", "model = \"clamped_stretches\"\ncritical_compression = 1\n"), HasSubstr("critical_compression"));
}

TEST(MaterialFactoryTest, DescribesEveryModel) {
  Parameters parameters = Parameters::describe();
  parameters.named_sections("material", [&](Parameters& p, const std::string& name) {
    EXPECT_EQ(make_extended(p, name), nullptr);
  });
  const std::string text = parameters.describe_text();
  for (const char* word : {"neo_hookean", "split_neo_hookean", "springs", "youngs_modulus", "spring_modulus",
                           "linear_fluid", "viscosity", "snow", "drucker_prager", "friction_angle", "yield_stress",
                           "fracture_toughness", "density"})
    EXPECT_THAT(text, testing::HasSubstr(word));
}

TEST(MaterialFactoryTest, ANewLawIsOneFileAndOneLine) {
  const auto material =
      read<3>("model = \"springs\"\ndensity = 1000\nspring_modulus = \"2 kPa\"\n", make_extended);
  EXPECT_STREQ(material->model(), "springs");
  EXPECT_FALSE(material->splits_energy());
  EXPECT_FALSE(material->has_tangent());
  alignas(64) float storage[9][16] = {}, out[16];
  MaterialColumns<3, float> columns;
  for (int k = 0; k < 9; ++k) {
    if (k % 4 == 0) std::fill_n(storage[k], 16, k == 0 ? 1.5f : 1.0f);
    columns.F[k] = storage[k];
  }
  material->energy_density(columns, 0, 16, out);
  for (const float energy : out) EXPECT_EQ(energy, 250);  // 2000/2 * 0.5^2
  try {
    require_ability_among<3>(ExtendedList{}, *material, MaterialAbility::tangent, "time.integrator");
    FAIL() << "springs have no tangent";
  } catch (const UserError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("\"neo_hookean\", \"split_neo_hookean\""));
  }
  // The same scene with the list of the program knows no such law.
  EXPECT_THROW(read<3>("model = \"springs\"\ndensity = 1000\n"), UserError);
}

}  // namespace
}  // namespace mpm::test
