// Live motion from `motion-jax studio` on a Humanoid character in Unity. Untested in Unity: only the syntax was checked.
//
// Put this script on the character, in its T-pose, next to its Animator (Humanoid avatar, no controller). Set Address to
// what the studio printed, press Play, and call Say("a person jumps"). docs/protocol.md describes the messages.
using System;
using System.Collections.Concurrent;
using System.IO;
using System.Net.WebSockets;
using System.Text;
using System.Threading;
using System.Threading.Tasks;
using UnityEngine;

public class MotionJaxStream : MonoBehaviour
{
    public string Address = "http://127.0.0.1:8765/?token=...";
    public string Prompt = "a person walks forward";

    [Serializable] class Pose { public string[] joints; public int[] parents; public float fps; public float delay; }
    [Serializable] class Message { public string type; public string message; public Pose pose; }

    readonly ConcurrentQueue<float[]> rows = new ConcurrentQueue<float[]>();
    readonly CancellationTokenSource ends = new CancellationTokenSource();
    readonly SemaphoreSlim sending = new SemaphoreSlim(1);
    readonly ClientWebSocket socket = new ClientWebSocket();
    volatile Pose about;
    Transform[] bones;
    Quaternion[] rest, turned;
    Vector3 start;
    float scale, clock;

    async void Start()
    {
        try
        {
            var page = new Uri(Address);
            var stream = new Uri("ws://" + page.Authority + "/v1/stream" + page.Query);
            await socket.ConnectAsync(stream, ends.Token);
            await Send("{\"type\": \"start\", \"pose\": \"rig:unity\", \"prompt\": " + Quote(Prompt) + "}");
            await Task.Run(Receive);
        }
        catch (OperationCanceledException) { }
        catch (Exception error) { Debug.LogError("motion_jax: " + error.Message); }
    }

    public async void Say(string prompt)
    {
        try { await Send("{\"type\": \"prompt\", \"prompt\": " + Quote(prompt) + "}"); }
        catch (Exception error) { Debug.LogError("motion_jax: " + error.Message); }
    }

    async Task Send(string text)
    {
        await sending.WaitAsync(ends.Token);
        try
        {
            var bytes = new ArraySegment<byte>(Encoding.UTF8.GetBytes(text));
            await socket.SendAsync(bytes, WebSocketMessageType.Text, true, ends.Token);
        }
        finally { sending.Release(); }
    }

    static string Quote(string text)
    {
        return "\"" + text.Replace("\\", "\\\\").Replace("\"", "\\\"") + "\"";
    }

    async Task Receive()
    {
        var buffer = new byte[1 << 16];
        while (!ends.IsCancellationRequested)
        {
            var whole = new MemoryStream();
            WebSocketReceiveResult part;
            do
            {
                part = await socket.ReceiveAsync(new ArraySegment<byte>(buffer), ends.Token);
                whole.Write(buffer, 0, part.Count);
            } while (!part.EndOfMessage);
            if (part.MessageType == WebSocketMessageType.Close) return;
            var bytes = whole.ToArray();
            if (part.MessageType == WebSocketMessageType.Text) ReadText(Encoding.UTF8.GetString(bytes));
            else if (bytes[3] == (byte)'P') ReadPoses(bytes);
            else await Send("{\"type\": \"ack\", \"sequence\": " + BitConverter.ToUInt32(bytes, 8) + "}");
        }
    }

    void ReadText(string text)
    {
        var message = JsonUtility.FromJson<Message>(text);
        if (message.type == "started") about = message.pose;
        if (message.type == "error") Debug.LogError("motion_jax: " + message.message);
    }

    void ReadPoses(byte[] bytes)
    {
        int header = BitConverter.ToUInt16(bytes, 6), count = BitConverter.ToUInt16(bytes, 20);
        int width = BitConverter.ToUInt16(bytes, 22);
        for (int k = 0; k < count; k++)
        {
            var row = new float[width];
            Buffer.BlockCopy(bytes, header + 4 * width * k, row, 0, 4 * width);
            rows.Enqueue(row);
        }
    }

    void Update()
    {
        if (about == null) return;
        if (bones == null) Bind();
        float[] row = null;
        clock = Mathf.Min(clock + Time.deltaTime * about.fps, 10);
        while (clock >= 1 && rows.TryDequeue(out var next)) { row = next; clock -= 1; }
        if (row != null) Apply(row);
    }

    void Bind()
    {
        var animator = GetComponent<Animator>();
        bones = new Transform[about.joints.Length];
        rest = new Quaternion[bones.Length];
        turned = new Quaternion[bones.Length];
        for (int j = 0; j < bones.Length; j++)
        {
            // The joints of rig:unity have the names of HumanBodyBones; a character may lack some, such as UpperChest.
            if (Enum.TryParse(about.joints[j], out HumanBodyBones bone)) bones[j] = animator.GetBoneTransform(bone);
            if (bones[j] != null) rest[j] = Quaternion.Inverse(transform.rotation) * bones[j].rotation;
        }
        start = transform.InverseTransformPoint(bones[0].position);
        animator.enabled = false; // it would overwrite the pose
    }

    void Apply(float[] row)
    {
        // The studio: right-handed, x to the left of a body that looks along z. Unity: left-handed, x to its right.
        for (int j = 0; j < bones.Length; j++)
        {
            int at = 3 + 4 * j; // w, x, y, z relative to the parent
            var local = new Quaternion(row[at + 1], -row[at + 2], -row[at + 3], row[at]);
            turned[j] = about.parents[j] < 0 ? local : turned[about.parents[j]] * local;
            if (bones[j] != null) bones[j].rotation = transform.rotation * turned[j] * rest[j];
        }
        if (scale == 0) scale = start.y / 0.9f; // hips of the studio's body stand 0.9 m above the floor
        var root = new Vector3(-row[0], row[1], row[2]) * scale;
        bones[0].position = transform.TransformPoint(root);
    }

    void OnDestroy()
    {
        ends.Cancel();
        socket.Dispose();
    }
}
