import sys,math,bisect,statistics as S,pickle
runs=[]
for fn in sys.argv[1:]:
    L={}
    for l in open(fn):
        if l[0] in 'EP' and l[1]==' ':
            w=l.split(None,2); L.setdefault(w[1],[]).append(l)
    for k,ls in L.items():
        T=[];PX=[];D=[]
        for l in ls:
            a=l.split()
            if l[0]=='P': T.append(float(a[2]));PX.append(tuple(map(float,a[3:6])))
            elif a[3]=='Log' and len(a)>4 and a[4]=='D':
                v=a[5:];D.append((float(a[2]),float(v[0]),float(v[1]),float(v[2]),float(v[3]),v[4]=='true',v[5]=='true')+tuple(map(float,v[6:])))
        def true(t):
            j=bisect.bisect(T,t)
            if j==0: return PX[0]
            if j>=len(T): return PX[-1]
            u=(t-T[j-1])/(T[j]-T[j-1]); p,q=PX[j-1],PX[j]
            return tuple(p[m]+u*(q[m]-p[m]) for m in range(3))
        seg=[];segs=[]
        for d in D:
            if seg and (d[4]<seg[-1][4]-1e-6 or d[0]-seg[-1][0]>1.0 or d[5]): 
                if seg: segs.append(seg)
                seg=[]
            if not d[5]: seg.append(d)
        if seg: segs.append(seg)
        for seg in segs:
            r=[]
            for a,b in zip(seg,seg[1:]):
                dt=b[0]-a[0]
                if dt<=0: continue
                bm=math.hypot(b[1]-a[1],b[2]-a[2]); p,q=true(a[0]-.3),true(b[0])
                tm=math.hypot(q[0]-p[0],q[1]-p[1])/(dt+.3)*dt
                r.append((b[0],b[3],b[4],bm,tm,bm/dt>.06 and tm/dt<.025,b[6],b[10],b[11],b[12],b[13],b[15]))
            if len(r)>3: runs.append(r)
pickle.dump(runs,open('runs.pkl','wb'))
print(len(runs),'drives')
