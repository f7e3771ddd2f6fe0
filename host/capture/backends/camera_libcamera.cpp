// A thin layer over libcamera: requests go round, the newest completed ones wait to be taken.
#include "capture/backends/camera_libcamera.h"

#include "base/clock.h"

#include <array>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <libcamera/libcamera.h>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <new>
#include <sys/mman.h>
#include <time.h>
#include <vector>

namespace {

constexpr double stamp_sigma_ns = 1e5; // of a sensor's own time of exposure: one or some rows
constexpr unsigned buffers_wanted = 4;
constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

struct mapping {
    void *at;
    size_t size;
};

struct libcamera_device : camera_device {
    std::unique_ptr<libcamera::CameraManager> manager;
    std::shared_ptr<libcamera::Camera> camera;
    std::unique_ptr<libcamera::CameraConfiguration> config;
    std::unique_ptr<libcamera::FrameBufferAllocator> allocator;
    std::vector<std::unique_ptr<libcamera::Request>> requests;
    std::map<const libcamera::FrameBuffer *, mapping> mapped;
    libcamera::ControlList controls;
    camera_settings settings{};
    bool running = false, gone = false;
    libcamera::Request *held = nullptr; // its frame is the caller's
    // shared with libcamera's thread
    std::mutex lock;
    std::condition_variable came;
    std::deque<libcamera::Request *> done;

    void completed(libcamera::Request *request) {
        std::lock_guard<std::mutex> guard(lock);
        done.push_back(request);
        came.notify_one();
    }
    void disconnected() {
        std::lock_guard<std::mutex> guard(lock);
        gone = true;
        came.notify_one();
    }
};

libcamera_device *of(camera_device *camera) {
    return static_cast<libcamera_device *>(camera);
}

// Runs an operation; no exception leaves this file.
template <typename F> enum st guarded(errctx *err, F &&operation) noexcept {
    try {
        return operation();
    } catch (const std::bad_alloc &) {
        return errctx_set(err, ST_NOMEM, "no memory for the camera");
    } catch (const std::exception &e) {
        return errctx_set(err, ST_DEVICE, "libcamera: %s", e.what());
    } catch (...) {
        return errctx_set(err, ST_DEVICE, "libcamera failed");
    }
}

enum st failed(errctx *err, const char *doing) {
    return errctx_set(err, ST_DEVICE, "the camera fails while %s (libcamera)", doing);
}

enum st identify(camera_device *camera, camera_device_identity *out_identity,
                 errctx *err) noexcept {
    return guarded(err, [&] {
        camera_device_identity id{};
        const auto &properties = of(camera)->camera->properties();
        const auto model = properties.get(libcamera::properties::Model);
        std::strncpy(id.driver, "libcamera", sizeof id.driver - 1);
        if (model)
            std::strncpy(id.product, model->c_str(), sizeof id.product - 1);
        std::strncpy(id.serial, of(camera)->camera->id().c_str(), sizeof id.serial - 1);
        *out_identity = id;
        return ST_OK;
    });
}

struct known_format {
    libcamera::PixelFormat pixels;
    camera_format format;
};

// The best first. DRM's BGR888 is R G B in memory.
const std::array<known_format, 3> &known_formats() {
    static const std::array<known_format, 3> formats{
        {{libcamera::formats::MJPEG, CAMERA_FORMAT_JPEG},
         {libcamera::formats::BGR888, CAMERA_FORMAT_RGB24},
         {libcamera::formats::YUYV, CAMERA_FORMAT_YUYV}}};
    return formats;
}

bool choose_format(libcamera::StreamConfiguration *stream) {
    for (const known_format &known : known_formats())
        for (const libcamera::PixelFormat &offered : stream->formats().pixelformats())
            if (offered == known.pixels) {
                stream->pixelFormat = known.pixels;
                return true;
            }
    return false;
}

// Puts a control into the list; false if the camera has none.
template <typename T, typename V>
bool lock_control(libcamera_device *c, const libcamera::Control<T> &control, V value) {
    if (!c->camera->controls().count(control.id()))
        return false;
    c->controls.set(control, value);
    return true;
}

void lock_settings(libcamera_device *c, camera_settings *s) {
    using namespace libcamera;
    c->controls = ControlList(c->camera->controls());
    if (!std::isnan(s->exposure_s) || !std::isnan(s->gain))
        lock_control(c, controls::AeEnable, false);
    if (!std::isnan(s->exposure_s) &&
        !lock_control(c, controls::ExposureTime,
                      static_cast<int32_t>(std::lround(s->exposure_s * 1e6))))
        s->exposure_s = unknown;
    if (!std::isnan(s->gain) &&
        !lock_control(c, controls::AnalogueGain, static_cast<float>(s->gain)))
        s->gain = unknown;
    if (!std::isnan(s->focus_diopter)) {
        lock_control(c, controls::AfMode, static_cast<int32_t>(controls::AfModeManual));
        if (!lock_control(c, controls::LensPosition, static_cast<float>(s->focus_diopter)))
            s->focus_diopter = unknown;
    }
    if (!std::isnan(s->white_balance_k))
        lock_control(c, controls::AwbEnable, false);
    s->white_balance_k = unknown; // held, but at no known temperature
}

enum st configure(camera_device *camera, camera_settings *in_out_settings, errctx *err) noexcept {
    libcamera_device *c = of(camera);
    return guarded(err, [&] {
        c->config = c->camera->generateConfiguration({libcamera::StreamRole::StillCapture});
        if (!c->config || c->config->size() != 1)
            return failed(err, "being set");
        libcamera::StreamConfiguration &stream = c->config->at(0);
        if (!choose_format(&stream))
            return errctx_set(err, ST_UNSUPPORTED,
                              "the camera gives neither JPEG nor RGB nor YUYV (libcamera)");
        stream.size = {in_out_settings->width_px, in_out_settings->height_px};
        stream.bufferCount = buffers_wanted;
        const libcamera::PixelFormat wanted = stream.pixelFormat;
        if (c->config->validate() == libcamera::CameraConfiguration::Invalid ||
            stream.pixelFormat != wanted || c->camera->configure(c->config.get()))
            return failed(err, "being set");
        camera_settings s = *in_out_settings;
        s.width_px = stream.size.width;
        s.height_px = stream.size.height;
        lock_settings(c, &s);
        c->settings = *in_out_settings = s;
        return ST_OK;
    });
}

bool map_buffer(libcamera_device *c, const libcamera::FrameBuffer &buffer) {
    const auto &plane = buffer.planes()[0]; // the formats above have one
    const size_t size = plane.offset + plane.length;
    void *at = mmap(nullptr, size, PROT_READ, MAP_SHARED, plane.fd.get(), 0);
    if (at == MAP_FAILED)
        return false;
    c->mapped[&buffer] = {at, size};
    return true;
}

void release_buffers(libcamera_device *c) {
    c->requests.clear();
    for (const auto &entry : c->mapped)
        munmap(entry.second.at, entry.second.size);
    c->mapped.clear();
    c->allocator.reset();
    c->held = nullptr;
    c->done.clear();
}

bool prepare(libcamera_device *c) {
    libcamera::Stream *stream = c->config->at(0).stream();
    c->allocator = std::make_unique<libcamera::FrameBufferAllocator>(c->camera);
    if (c->allocator->allocate(stream) < 0)
        return false;
    for (const auto &buffer : c->allocator->buffers(stream)) {
        std::unique_ptr<libcamera::Request> request = c->camera->createRequest();
        if (!request || request->addBuffer(stream, buffer.get()) || !map_buffer(c, *buffer))
            return false;
        request->controls().merge(c->controls);
        c->requests.push_back(std::move(request));
    }
    return true;
}

enum st start(camera_device *camera, errctx *err) noexcept {
    libcamera_device *c = of(camera);
    return guarded(err, [&] {
        if (!c->config || c->running)
            return errctx_set(err, ST_INVALID, "the camera must be set before it starts, once");
        bool good = prepare(c) && !c->camera->start(&c->controls);
        c->running = good;
        for (size_t i = 0; good && i < c->requests.size(); i++)
            good = !c->camera->queueRequest(c->requests[i].get());
        if (good)
            return ST_OK;
        if (c->running)
            c->camera->stop();
        c->running = false;
        release_buffers(c);
        return failed(err, "starting");
    });
}

// What a completed request holds; false if its frame is not whole.
bool describe(const libcamera_device *c, libcamera::Request *request, camera_frame *out_frame) {
    const libcamera::StreamConfiguration &stream = c->config->at(0);
    const libcamera::FrameBuffer *buffer = request->findBuffer(stream.stream());
    if (!buffer || request->status() != libcamera::Request::RequestComplete ||
        buffer->metadata().status != libcamera::FrameMetadata::FrameSuccess)
        return false;
    const libcamera::ControlList &meta = request->metadata();
    const auto stamp = meta.get(libcamera::controls::SensorTimestamp);
    const auto exposure = meta.get(libcamera::controls::ExposureTime);
    const auto gain = meta.get(libcamera::controls::AnalogueGain);
    timespec boot{}; // libcamera's clock goes on while the machine sleeps
    (void)clock_gettime(CLOCK_BOOTTIME, &boot);
    const int64_t asleep_ns =
        static_cast<int64_t>(boot.tv_sec) * 1000000000 + boot.tv_nsec - clock_now_ns();
    camera_frame f{};
    const auto &plane = buffer->planes()[0];
    f.bytes = static_cast<const uint8_t *>(c->mapped.at(buffer).at) + plane.offset;
    f.size = buffer->metadata().planes()[0].bytesused;
    f.width_px = stream.size.width;
    f.height_px = stream.size.height;
    for (const known_format &known : known_formats())
        if (known.pixels == stream.pixelFormat)
            f.format = known.format;
    f.stride_bytes = f.format == CAMERA_FORMAT_JPEG ? 0 : stream.stride;
    f.seq = buffer->metadata().sequence;
    f.t_ns = (stamp ? *stamp : static_cast<int64_t>(buffer->metadata().timestamp)) - asleep_ns;
    f.t_sigma_ns = stamp_sigma_ns;
    f.exposure_s = exposure ? *exposure * 1e-6 : unknown;
    f.gain = gain ? static_cast<double>(*gain) : unknown;
    const double near = 0.02; // sensors count rows
    f.settings_held =
        (std::isnan(c->settings.exposure_s) || std::isnan(f.exposure_s) ||
         std::fabs(f.exposure_s - c->settings.exposure_s) <= near * c->settings.exposure_s) &&
        (std::isnan(c->settings.gain) || std::isnan(f.gain) ||
         std::fabs(f.gain - c->settings.gain) <= near * c->settings.gain);
    *out_frame = f;
    return true;
}

bool send_again(libcamera_device *c, libcamera::Request *request) {
    request->reuse(libcamera::Request::ReuseBuffers);
    request->controls().merge(c->controls);
    return !c->camera->queueRequest(request);
}

enum st frame(camera_device *camera, int64_t after_ns, unsigned timeout_ms, camera_frame *out_frame,
              errctx *err) noexcept {
    libcamera_device *c = of(camera);
    return guarded(err, [&] {
        const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(timeout_ms);
        if (!c->running)
            return errctx_set(err, ST_INVALID, "the camera does not run");
        for (;;) {
            if (c->held && !send_again(c, c->held))
                return failed(err, "taking frames");
            c->held = nullptr;
            {
                std::unique_lock<std::mutex> guard(c->lock);
                const bool in_time =
                    c->came.wait_until(guard, end, [&] { return c->gone || !c->done.empty(); });
                if (c->gone)
                    return errctx_set(err, ST_DEVICE, "the camera is gone: is it unplugged?");
                if (!in_time)
                    return errctx_set(err, ST_TIMEOUT, "no frame came from the camera");
                c->held = c->done.front();
                c->done.pop_front();
            }
            camera_frame f{};
            if (describe(c, c->held, &f) && f.t_ns >= after_ns) {
                *out_frame = f;
                return ST_OK;
            }
            if (std::chrono::steady_clock::now() > end)
                return errctx_set(err, ST_TIMEOUT, "no whole frame came from the camera in time");
        }
    });
}

enum st stop(camera_device *camera, errctx *err) noexcept {
    libcamera_device *c = of(camera);
    return guarded(err, [&] {
        if (!c->running)
            return ST_OK;
        c->running = false;
        const int bad = c->camera->stop();
        release_buffers(c);
        return bad ? failed(err, "stopping") : ST_OK;
    });
}

void close_camera(camera_device *camera) noexcept {
    libcamera_device *c = of(camera);
    (void)stop(camera, nullptr);
    if (c->camera) {
        c->camera->requestCompleted.disconnect();
        c->camera->disconnected.disconnect();
        (void)c->camera->release();
    }
    c->config.reset();
    c->camera.reset();
    if (c->manager)
        c->manager->stop();
    delete c;
}

const camera_device_ops libcamera_ops = {identify, configure, start, frame, stop, close_camera};

enum st find(libcamera_device *c, const char *name, errctx *err) {
    c->manager = std::make_unique<libcamera::CameraManager>();
    if (c->manager->start()) {
        c->manager.reset();
        return errctx_set(err, ST_DEVICE, "libcamera does not start");
    }
    const auto cameras = c->manager->cameras();
    for (const auto &camera : cameras)
        if (!name || !*name || camera->id() == name) {
            c->camera = camera;
            break;
        }
    if (!c->camera)
        return errctx_set(err, ST_NOT_FOUND, "libcamera knows no camera '%s': see `cam --list`",
                          name ? name : "");
    if (c->camera->acquire()) {
        c->camera.reset();
        return errctx_set(err, ST_BUSY, "the camera is in use by another program");
    }
    c->camera->requestCompleted.connect(c, &libcamera_device::completed);
    c->camera->disconnected.connect(c, &libcamera_device::disconnected);
    return ST_OK;
}

} // namespace

extern "C" enum st camera_libcamera_open(const char *name, camera_device **out_camera,
                                         errctx *err) {
    return guarded(err, [&] {
        auto c = std::make_unique<libcamera_device>();
        c->ops = &libcamera_ops;
        libcamera::logSetTarget(libcamera::LoggingTargetNone); // the library does not print
        const enum st st = find(c.get(), name, err);
        if (st)
            close_camera(c.release());
        else
            *out_camera = c.release();
        return st;
    });
}
