// The peer: PCL's RangeImagePlanar on the points of bench_fusion peer-write. Prints the seconds it took.
// Build: c++ -O3 -I/usr/include/pcl-1.13 -I/usr/include/eigen3 peer_pcl.cpp -lpcl_common
#include <chrono>
#include <cstdio>
#include <vector>

#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/range_image/range_image_planar.h>

int main(int argc, char **argv) {
    if (argc != 3)
        return 2;
    std::FILE *in = std::fopen(argv[1], "rb");
    float head[6], xyz[3];
    if (!in || std::fread(head, sizeof head, 1, in) != 1)
        return 1;
    pcl::PointCloud<pcl::PointXYZ> cloud;
    while (std::fread(xyz, sizeof xyz, 1, in) == 1)
        cloud.push_back(pcl::PointXYZ(xyz[0], xyz[1], xyz[2]));
    std::fclose(in);
    double best = 1e9;
    pcl::RangeImagePlanar image;
    for (int round = 0; round < 3; round++) {
        auto start = std::chrono::steady_clock::now();
        image.createFromPointCloudWithFixedSize(cloud, int(head[0]), int(head[1]), head[4], head[5], head[2],
                                                head[3], Eigen::Affine3f::Identity(),
                                                pcl::RangeImage::CAMERA_FRAME, 0.0f, 0.0f);
        std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
        best = took.count() < best ? took.count() : best;
    }
    std::vector<float> range;
    for (int y = 0; y < int(image.height); y++)
        for (int x = 0; x < int(image.width); x++)
            range.push_back(image.isValid(x, y) ? image.getPoint(x, y).range : 0.0f);
    std::FILE *out = std::fopen(argv[2], "wb");
    if (!out || std::fwrite(range.data(), sizeof(float), range.size(), out) != range.size())
        return 1;
    std::fclose(out);
    std::printf("%.6f\n", best);
}
