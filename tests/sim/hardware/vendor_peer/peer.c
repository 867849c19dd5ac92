/* A robot, or a program that commands one, on the vendor's version of DDS: the C core of cyclonedds 0.10, types from its IDL
   compiler, the checksum as the vendor writes it. Nothing in here is ours, so it can contradict what is.

   usage: peer DOMAIN robot|program        (CYCLONEDDS_URI configures the network)

   A robot publishes rt/lowstate, reads rt/lowcmd and answers the motion switcher; a program does the reverse. Every line on
   standard input is answered by one line of JSON: what has been heard so far. The end of standard input ends the peer. */

#include <poll.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "dds/dds.h"
#include "unitree_api.h"
#include "unitree_go.h"

typedef unitree_go_msg_dds__LowCmd_ LowCmd;
typedef unitree_go_msg_dds__LowState_ LowState;
typedef unitree_api_msg_dds__Request_ Request;
typedef unitree_api_msg_dds__Response_ Response;

enum { SLOTS = 20, PERIOD_MS = 2, ASK_EVERY = 50, CHECK_MODE = 1001, RELEASE_MODE = 1003 };

_Static_assert(sizeof(LowCmd) == 812 && sizeof(LowState) == 1180, "the checksum runs over the vendor's C structures");

static dds_entity_t participant, commands, states, requests, responses;
static LowCmd command; /* last sent or heard */
static LowState state;
static unsigned sound, unsound, calls;
static char mode[] = "normal";
static char answer[64] = "null";

static dds_entity_t check(dds_return_t result, const char *what)
{
    if (result < 0) {
        fprintf(stderr, "%s: %s\n", what, dds_strretcode(result));
        exit(2);
    }
    return result;
}

static dds_entity_t end_of(const dds_topic_descriptor_t *type, const char *name, bool writes, bool reliable)
{
    dds_entity_t topic = check(dds_create_topic(participant, type, name, NULL, NULL), name);
    dds_qos_t *qos = dds_create_qos();
    if (reliable)
        dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
    dds_entity_t end =
        writes ? dds_create_writer(participant, topic, qos, NULL) : dds_create_reader(participant, topic, qos, NULL);
    dds_delete_qos(qos);
    return check(end, name);
}

/* All 32-bit words of a message but the last, most significant bit first. */
static uint32_t checksum(const void *message, size_t size)
{
    uint32_t crc = 0xFFFFFFFF;
    for (size_t offset = 0; offset + 4 < size; offset += 4) {
        uint32_t word;
        memcpy(&word, (const char *)message + offset, 4);
        for (uint32_t bit = 1u << 31; bit; bit >>= 1) {
            crc = crc & 1u << 31 ? crc << 1 ^ 0x04C11DB7 : crc << 1;
            if (word & bit)
                crc ^= 0x04C11DB7;
        }
    }
    return crc;
}

static void send_state(void)
{
    for (int i = 0; i < SLOTS; i++)
        state.motor_state[i] = (unitree_go_msg_dds__MotorState_){
            .mode = 1, .q = 0.25f * i, .dq = -0.5f * i, .tau_est = 1.5f * i, .temperature = 30 + i, .lost = 100 + i};
    state.imu_state = (unitree_go_msg_dds__IMUState_){
        .quaternion = {0.5f, -0.5f, 0.5f, -0.5f}, .gyroscope = {0.25f, 0.5f, 0.75f}, .accelerometer = {1.5f, -2.5f, 9.75f}};
    state.bms_state.soc = 77;
    state.power_v = 28.5f;
    state.wireless_remote[2] = 0x20; /* L2 */
    state.wireless_remote[3] = 0x02; /* B */
    state.tick += PERIOD_MS;
    state.crc = checksum(&state, sizeof state);
    check(dds_write(states, &state), "rt/lowstate");
}

static void send_command(void)
{
    for (int i = 0; i < SLOTS; i++)
        command.motor_cmd[i] = (unitree_go_msg_dds__MotorCmd_){
            .mode = 1, .q = 0.25f * i, .dq = -0.5f * i, .tau = 1.5f * i, .kp = 2.0f * i, .kd = 0.125f * i};
    command.crc = checksum(&command, sizeof command);
    check(dds_write(commands, &command), "rt/lowcmd");
}

/* Takes one message if there is one. It is taken into zeroed memory, because padding counts in the checksum. */
static void take(dds_entity_t reader, void *newest, size_t size)
{
    static union { LowCmd command; LowState state; } memory;
    void *sample = &memory;
    dds_sample_info_t info;
    memset(&memory, 0, sizeof memory);
    if (check(dds_take(reader, &sample, &info, 1, 1), "take") == 0 || !info.valid_data)
        return;
    uint32_t crc;
    memcpy(&crc, (char *)sample + size - sizeof crc, sizeof crc);
    if (crc != checksum(sample, size)) {
        unsound++;
        return;
    }
    sound++;
    memcpy(newest, sample, size);
}

static void respond(const Request *request)
{
    char data[64] = "";
    Response response = {.header.identity = request->header.identity, .data = data};
    if (request->header.identity.api_id == CHECK_MODE)
        snprintf(data, sizeof data, "{\"form\": \"0\", \"name\": \"%s\"}", mode);
    else if (request->header.identity.api_id == RELEASE_MODE)
        mode[0] = 0;
    check(dds_write(responses, &response), "response");
}

static void ask(unsigned id)
{
    Request request = {.header.identity = {id, CHECK_MODE}, .parameter = "{}"};
    check(dds_write(requests, &request), "request");
}

static void take_calls(bool is_robot)
{
    dds_entity_t reader = is_robot ? requests : responses;
    void *sample = NULL;
    dds_sample_info_t info;
    while (check(dds_take(reader, &sample, &info, 1, 1), "take") == 1) {
        if (info.valid_data) {
            calls++;
            if (is_robot)
                respond(sample);
            else
                snprintf(answer, sizeof answer, "%s", ((const Response *)sample)->data);
        }
        dds_return_loan(reader, &sample, 1);
    }
}

static void report(void)
{
    printf("{\"sound\": %u, \"unsound\": %u, \"calls\": %u, \"answer\": %s, \"command\": \"", sound, unsound, calls, answer);
    for (size_t i = 0; i < sizeof command; i++)
        printf("%02x", ((const unsigned char *)&command)[i]);
    printf("\"}\n");
    fflush(stdout);
}

int main(int argc, char **argv)
{
    if (argc != 3)
        return 2;
    bool is_robot = strcmp(argv[2], "robot") == 0;
    participant = check(dds_create_participant((dds_domainid_t)atoi(argv[1]), NULL, NULL), "participant");
    commands = end_of(&unitree_go_msg_dds__LowCmd__desc, "rt/lowcmd", !is_robot, false);
    states = end_of(&unitree_go_msg_dds__LowState__desc, "rt/lowstate", is_robot, false);
    requests = end_of(&unitree_api_msg_dds__Request__desc, "rt/api/motion_switcher/request", !is_robot, true);
    responses = end_of(&unitree_api_msg_dds__Response__desc, "rt/api/motion_switcher/response", is_robot, true);
    for (unsigned tick = 0;; tick++) {
        struct pollfd input = {.fd = STDIN_FILENO, .events = POLLIN};
        if (poll(&input, 1, PERIOD_MS) > 0) {
            char byte;
            if (read(STDIN_FILENO, &byte, 1) != 1)
                break;
            report();
        }
        if (is_robot) {
            send_state();
            take(commands, &command, sizeof command);
        } else {
            send_command();
            take(states, &state, sizeof state);
            if (tick % ASK_EVERY == 0)
                ask(tick);
        }
        take_calls(is_robot);
    }
    check(dds_delete(participant), "participant");
    return 0;
}
