// What Gazebo's reader, libsdformat, makes of a model: a line of numbers for each part.
#include <iostream>
#include <sdf/sdf.hh>

template <class Vector> void line(const Vector &v)
{
    std::cout << ' ' << v[0] << ' ' << v[1] << ' ' << v[2];
}

template <class Part> void pose(const Part &part, const std::string &from)
{
    auto at = part.RawPose();
    for (const auto &error : part.SemanticPose().Resolve(at, from))
        throw std::runtime_error(error.Message());
    line(at.Pos());
    std::cout << ' ' << at.Rot().W() << ' ' << at.Rot().X() << ' ' << at.Rot().Y() << ' '
              << at.Rot().Z();
}

int main(int, char **words)
{
    std::cout.precision(17);
    sdf::Root root;
    for (const auto &error : root.Load(words[1]))
        throw std::runtime_error(error.Message());
    bool sound = sdf::checkCanonicalLinkNames(&root) && sdf::checkFrameAttachedToNames(&root) &&
                 sdf::checkFrameAttachedToGraph(&root) && sdf::checkPoseRelativeToGraph(&root) &&
                 sdf::recursiveSiblingUniqueNames(root.Element());
    if (!sound)
        throw std::runtime_error("the checks of gz sdf --check fail");
    const auto &model = *root.Model();
    for (uint64_t i = 0; i < model.LinkCount(); i++) {
        const auto &link = *model.LinkByIndex(i);
        const auto &body = link.Inertial();
        const auto I = body.Moi();
        std::cout << "link " << link.Name() << ' ' << body.MassMatrix().Mass();
        line(body.Pose().Pos());
        for (int row = 0; row < 3; row++)
            std::cout << ' ' << I(row, 0) << ' ' << I(row, 1) << ' ' << I(row, 2);
        std::cout << '\n';
    }
    for (uint64_t i = 0; i < model.JointCount(); i++) {
        const auto &joint = *model.JointByIndex(i);
        std::string parent, child;
        joint.ResolveParentLink(parent);
        joint.ResolveChildLink(child);
        auto axis = joint.Axis(0)->Xyz();
        joint.Axis(0)->ResolveXyz(axis, child);
        bool slides = joint.Type() == sdf::JointType::PRISMATIC;
        std::cout << (slides ? "prismatic " : "revolute ") << joint.Name() << ' ' << parent << ' '
                  << child << ' ' << joint.Axis(0)->Lower() << ' ' << joint.Axis(0)->Upper();
        line(axis);
        pose(*model.LinkByName(child), parent);
        std::cout << '\n';
    }
    for (uint64_t i = 0; i < model.FrameCount(); i++) {
        const auto &frame = *model.FrameByIndex(i);
        std::cout << "frame " << frame.Name() << ' ' << frame.AttachedTo();
        pose(frame, frame.AttachedTo());
        std::cout << '\n';
    }
}
